"""How sure scores are: intervals of means, and tests of differences.

Intervals come from a hierarchical bootstrap. Windows of one sequence share its scene and motion, so
they are not independent draws. Resampling draws seeds first and then windows within each seed drawn
(Davison & Hinkley, Bootstrap Methods and their Application, 1997, section 3.8). The statistic is
the mean in which every seed weighs the same, and within a seed every window. Of a handful of seeds
the resampled means spread too little, by the square root of n / (n - 1) and by what Student's t
makes of an estimated spread; of many windows they spread too much, as windows vary twice: in the
seeds' means and in the drawing. So they give the interval's shape, and the seeds' means its width.
One seed says nothing about others: it has no interval.

Two results are compared by the differences of their pairs, window by window of the same seed: by
the intervals above, and a t-test over the seeds' mean differences, corrected for the number of
tests.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtr, stdtrit

from eventsweep.emvs.errors import InputError

RESAMPLES = 2000
LEAST_RESAMPLES = 20
LEVEL = 0.95
ALPHA = 0.05
Floats = NDArray[np.float64]


def interval(
    groups: Sequence[NDArray[np.floating]], *, level: float = LEVEL, resamples: int = RESAMPLES,
    seed: int = 0,
) -> tuple[float, float]:  # fmt: skip
    """The interval of a mean, which holds the true one as often as `level` says.

    Args:
        groups: per seed, the values of its windows.
        level: in how many of many such samples the true mean lies inside.
        resamples: how many, 20 or more.
        seed: of the drawing; the same gives the same interval.

    Returns:
        Lower and upper end; NaN where fewer than two seeds are given or a value is undefined.
    """
    values = np.concatenate([np.asarray(group, np.float64) for group in groups] or [np.empty(0)])
    sizes = [len(group) for group in groups]
    low, high = intervals(values[:, None], sizes, level=level, resamples=resamples, seed=seed)
    return float(low[0]), float(high[0])


def intervals(
    values: Floats, sizes: Sequence[int], *, level: float = LEVEL, resamples: int = RESAMPLES,
    seed: int = 0,
) -> tuple[Floats, Floats]:  # fmt: skip
    """The intervals of M means at once, (M,) lower and (M,) upper ends, all from the same draws.

    The values are (N, M) of N windows, seed by seed, as many of each as `sizes` says; else see
    `interval`.

    Raises:
        InputError: sizes that do not add up to N, an empty group, or an impossible level or count.
    """
    if sum(sizes) != len(values) or min(sizes, default=1) < 1:
        raise InputError(
            f"groups of {list(sizes)} for {len(values)} values: each needs one or more"
        )
    if not 0 < level < 1 or resamples < LEAST_RESAMPLES:
        raise InputError(
            f"level {level:g} with {resamples} resamples: needs 0 < level < 1 and "
            f"{LEAST_RESAMPLES} or more"
        )
    if len(sizes) < 2:
        nothing = np.full(values.shape[1], np.nan)
        return nothing, nothing.copy()
    # A product of whole rows; not BLAS, whose rounding may depend on the number of threads.
    means = np.einsum(
        "bn,nm->bm", resampling_weights(sizes, resamples, seed), values, optimize=False
    )
    starts = np.cumsum([0, *sizes[:-1]])
    of_seeds = np.add.reduceat(values, starts, axis=0) / np.asarray(sizes)[:, None]
    return _as_wide_as_seeds_differ(means, of_seeds, level)


def _as_wide_as_seeds_differ(
    resampled: Floats, of_seeds: Floats, level: float
) -> tuple[Floats, Floats]:
    """Percentiles of the resampled means (B, M), stretched to the spread of seeds' means (G, M)."""
    n, tail = len(of_seeds), (1 - level) / 2
    mean, error = of_seeds.mean(axis=0), of_seeds.std(axis=0, ddof=1) / np.sqrt(n)
    wanted = error * stdtrit(n - 1, 1 - tail) / ndtri(1 - tail)
    found = resampled.std(axis=0)
    # Equal values have no spread to stretch.
    stretch = np.divide(wanted, found, out=np.zeros_like(found), where=found > 0)
    low, high = mean + stretch * (np.quantile(resampled, [tail, 1 - tail], axis=0) - mean)
    return low, high


def stratified_interval(
    strata: Sequence[NDArray[np.floating]], *, level: float = LEVEL
) -> tuple[float, float]:
    """The interval of the mean over fixed strata, such as cases, of the mean over each one's seeds.

    Student's t with Welch's and Satterthwaite's degrees of freedom (Biometrics Bulletin 2, 1946).
    Each stratum has one value per seed; NaN where one has fewer than two seeds or an undefined
    value.
    """
    mean, error, freedom = _stratified(strata)
    if not error > 0:  # NaN too: too few seeds, or seeds that do not differ
        return mean + error, mean + error
    half = float(stdtrit(freedom, (1 + level) / 2) * error)
    return mean - half, mean + half


def stratified_p(strata: Sequence[NDArray[np.floating]]) -> float:
    """Two-sided p of a mean of zero over fixed strata: the test that `stratified_interval` inverts.

    Given differences of pairs, one per seed, and one stratum, it is the paired t-test. 1 where all
    differences are zero; NaN where a stratum has fewer than two seeds or an undefined value.
    """
    mean, error, freedom = _stratified(strata)
    if np.isnan(error):
        return float("nan")
    if error == 0:
        return float(mean == 0)
    return float(2 * stdtr(freedom, -abs(mean) / error))


def _stratified(strata: Sequence[NDArray[np.floating]]) -> tuple[float, float, float]:
    """Mean over strata of the mean over seeds, its standard error and its degrees of freedom."""
    if min(map(len, strata), default=0) < 2:
        return float("nan"), float("nan"), float("nan")
    mean = float(np.mean([np.mean(values) for values in strata]))
    parts = np.array([np.var(values, ddof=1) / len(values) for values in strata]) / len(strata) ** 2
    if not parts.any():
        return mean, 0.0, float("nan")
    freedom = parts.sum() ** 2 / sum(
        part**2 / (len(values) - 1) for part, values in zip(parts, strata, strict=True)
    )
    return mean, float(np.sqrt(parts.sum())), float(freedom)


def resampling_weights(sizes: Sequence[int], resamples: int, seed: int) -> Floats:
    """Draws what each window weighs in each resampled mean: (B, N), rows add up to 1."""
    rng = np.random.default_rng(seed)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    drawn = np.zeros((resamples, int(starts[-1])))
    for row in drawn:
        for group in rng.integers(len(sizes), size=len(sizes)):
            size = sizes[group]
            windows = rng.integers(size, size=size)
            np.add.at(row, starts[group] + windows, 1 / (len(sizes) * size))
    return drawn


def holm(p: Sequence[float]) -> list[float]:
    """Corrects p values for their number so that any false alarm is rare.

    Holm's step-down procedure (Scand. J. Statist. 6, 1979): the k-th smallest of m is multiplied
    by m - k + 1, and none may be less than one before it. An undefined p was no test: it stays.
    """
    tested = sorted((value, place) for place, value in enumerate(p) if not np.isnan(value))
    corrected, least = list(p), 0.0
    for done, (value, place) in enumerate(tested):
        least = max(least, min(1.0, (len(tested) - done) * value))
        corrected[place] = least
    return corrected
