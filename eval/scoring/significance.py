"""How sure scores are: intervals of means, and whether one method is better than another.

Intervals come from a hierarchical bootstrap. Windows of one sequence share its scene and motion, so
they are not independent draws. Resampling draws seeds first and then windows within each seed drawn
(Davison & Hinkley, Bootstrap Methods and their Application, 1997, section 3.8). The statistic is
the mean in which every seed weighs the same, and within a seed every window. Of a handful of seeds
the resampled means spread too little, by the square root of n / (n - 1) and by what Student's t
makes of an estimated spread; of many windows they spread too much, as windows vary twice: in the
seeds' means and in the drawing. So they give the interval's shape, and the seeds' means its width.
One seed says nothing about others: it has no interval.

Two results are compared by the differences of their pairs, window by window of the same seed: by
the intervals above, and a t-test over the seeds' mean differences. Methods are compared by paired
tests, corrected for their number, and ranked. A unit is what was drawn independently: a sequence,
that is one case with one seed. Windows of one sequence are averaged first (window `mean` of the
results), or their number would feign certainty.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri, stdtr, stdtrit

from eventsweep.emvs.errors import InputError
from eventsweep.eval.scoring.metrics import Better
from eventsweep.eval.scoring.results import MEAN, Results, Row

RESAMPLES = 2000
LEAST_RESAMPLES = 20
LEVEL = 0.95
ALPHA = 0.05
PERMUTATIONS = 9999
Test = Literal["permutation", "wilcoxon"]
Floats = NDArray[np.float64]
Unit = tuple[str, int | None]


def interval(
    groups: Sequence[NDArray[np.floating]],
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> tuple[float, float]:
    """Returns the interval of the mean, which holds the true one as often as `level` says.

    Args:
        groups: per seed, the values of its windows.
        level: in how many of many such samples the true mean lies inside.
        resamples: how many, 20 or more.
        seed: of the drawing; the same gives the same interval.

    Returns:
        Lower and upper end; NaN where fewer than two seeds are given or a value is undefined.

    Raises:
        InputError: no values in a group, or a level or count that is none.
    """
    values = np.concatenate([np.asarray(group, np.float64) for group in groups] or [np.empty(0)])
    sizes = [len(group) for group in groups]
    low, high = intervals(values[:, None], sizes, level=level, resamples=resamples, seed=seed)
    return float(low[0]), float(high[0])


def intervals(
    values: Floats,
    sizes: Sequence[int],
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> tuple[Floats, Floats]:
    """Returns the intervals of many means at once, all from the same draws.

    Args:
        values: (N, M) values of N windows, seed by seed, for M numbers.
        sizes: windows of each seed, adding up to N.
        level: in how many of many such samples the true mean lies inside.
        resamples: how many, 20 or more.
        seed: of the drawing.

    Returns:
        (M,) lower and upper ends; NaN as `interval` has it.

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
    """Returns the interval of the mean over fixed strata of the mean over each one's seeds.

    Student's t with Welch's and Satterthwaite's degrees of freedom (Biometrics Bulletin 2, 1946).

    Args:
        strata: per stratum, such as a case, one value per seed.
        level: in how many of many such samples the true mean lies inside.

    Returns:
        Lower and upper end; NaN where a stratum has fewer than two seeds or an undefined value.
    """
    mean, error, freedom = _stratified(strata)
    if not error > 0:  # NaN too: too few seeds, or seeds that do not differ
        return mean + error, mean + error
    half = float(stdtrit(freedom, (1 + level) / 2) * error)
    return mean - half, mean + half


def stratified_p(strata: Sequence[NDArray[np.floating]]) -> float:
    """Two-sided p of a mean of zero over fixed strata: the test that `stratified_interval` inverts.

    Given differences of pairs, one per seed, and one stratum, it is the paired t-test.

    Args:
        strata: per stratum, such as a case, one difference per seed.

    Returns:
        p; 1 where all differences are zero; NaN where a stratum has fewer than two seeds or an
        undefined value.
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


@dataclass(frozen=True, slots=True)
class PairedComparison:
    """Two methods on the same units.

    Attributes:
        first: name of the one.
        second: name of the other.
        units: how many have a value of both.
        difference: mean of first minus second, in the metric's unit.
        p: of the paired test, two-sided.
        p_holm: corrected for all comparisons made.
    """

    first: str
    second: str
    units: int
    difference: float
    p: float
    p_holm: float


@dataclass(frozen=True, slots=True)
class Standing:
    """A method's place.

    Attributes:
        method: its name.
        rank: 1 plus the number of methods that are significantly better: ties share a rank.
        mean: over the units that all methods have.
    """

    method: str
    rank: int
    mean: float


@dataclass(frozen=True, slots=True)
class Ranking:
    """Who is ahead, and how surely.

    Attributes:
        standings: best mean first.
        comparisons: of every two methods.
        units: that all methods have a value of; others are left out for all.
    """

    standings: tuple[Standing, ...]
    comparisons: tuple[PairedComparison, ...]
    units: int


def paired_p(first: ArrayLike, second: ArrayLike, *, test: Test = "permutation") -> float:
    """Two-sided p of no difference between paired values.

    The permutation test swaps the two values of units at random, or in all ways where there are no
    more than 9999 of them, and asks how often the mean difference is as large; it needs 6 units to
    fall below 0.05. Wilcoxon's signed-rank test asks the ranks of the differences instead.

    Args:
        first: (N,) values of one method.
        second: (N,) values of another on the same units.
        test: which.

    Returns:
        p; 1 where all differences are zero; NaN for fewer than two units.

    Raises:
        InputError: values that do not pair up, or an undefined one.
    """
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if a.shape != b.shape or a.ndim != 1 or not np.isfinite(a).all() or not np.isfinite(b).all():
        raise InputError(f"values of shapes {a.shape} and {b.shape}: need pairs of finite numbers")
    if len(a) < 2:
        return float("nan")
    if np.array_equal(a, b):
        return 1.0
    from scipy import stats  # 0.5 s that intervals need not wait for

    if test == "wilcoxon":
        return float(stats.wilcoxon(a, b).pvalue)
    found = stats.permutation_test(
        (a, b),
        _mean_difference,
        permutation_type="samples",
        vectorized=True,
        n_resamples=PERMUTATIONS,
        random_state=np.random.default_rng(0),
    )
    return float(found.pvalue)


def _mean_difference(a: Floats, b: Floats, axis: int) -> Floats:
    return np.asarray(np.mean(a - b, axis=axis))


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


def rank_methods(
    values: Mapping[str, ArrayLike],
    better: Better,
    *,
    alpha: float = ALPHA,
    test: Test = "permutation",
) -> Ranking:
    """Ranks methods; where a difference is not significant, neither is ahead of the other.

    Args:
        values: per method, (N,) one value per unit in the same order; NaN where undefined.
        better: which direction is better.
        alpha: a corrected p below it is significant.
        test: which paired test.

    Returns:
        The ranking over the units that all methods have; without such units, all are first.

    Raises:
        InputError: methods with different numbers of units, or no better direction.
    """
    table = {method: np.asarray(found, np.float64) for method, found in values.items()}
    if len({len(found) for found in table.values()}) > 1 or better == "none":
        raise InputError(
            f"cannot rank {', '.join(table)}: needs as many units each and a better direction"
        )
    shared = np.isfinite(list(table.values())).all(axis=0) if table else np.zeros(0, bool)
    table = {method: found[shared] for method, found in table.items()}
    comparisons = _compare(table, test)
    means = {m: float(np.mean(v)) if len(v) else float("nan") for m, v in table.items()}
    sign = -1 if better == "higher" else 1
    losses = [_loser(one, sign) for one in comparisons if one.p_holm < alpha]
    standings = [Standing(m, 1 + losses.count(m), mean) for m, mean in means.items()]
    standings.sort(key=lambda one: (one.rank, sign * one.mean))
    return Ranking(tuple(standings), comparisons, int(np.count_nonzero(shared)))


def _compare(table: Mapping[str, Floats], test: Test) -> tuple[PairedComparison, ...]:
    couples = list(combinations(table, 2))
    p = [paired_p(table[a], table[b], test=test) for a, b in couples]
    return tuple(
        PairedComparison(a, b, len(table[a]), _mean(table[a] - table[b]), raw, corrected)
        for (a, b), raw, corrected in zip(couples, p, holm(p), strict=True)
    )


def _mean(values: Floats) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


def _loser(one: PairedComparison, sign: int) -> str:
    return one.first if sign * one.difference > 0 else one.second


def unit_values(
    runs: Iterable[Results], metric: str, window: str = MEAN
) -> tuple[tuple[Unit, ...], dict[str, NDArray[np.float64]], Better]:
    """Collects a metric over cases and seeds.

    Args:
        runs: results, of one seed each.
        metric: name of the metric.
        window: `mean` for the plain average over windows, `all` for pixels pooled.

    Returns:
        The units, case and seed; per method one value per unit, NaN where it has none; and which
        direction is better.

    Raises:
        InputError: no such rows, or a unit that two runs hold.
    """
    found: dict[str, dict[Unit, Row]] = {}
    for run in runs:
        for row in run.rows:
            if (row.metric, row.window) == (metric, window):
                _add(found.setdefault(row.method, {}), (row.case, run.seed), row)
    units = tuple(dict.fromkeys(unit for rows in found.values() for unit in rows))
    if not units:
        raise InputError(f"no rows of metric {metric} in window {window}: score the runs again")
    values = {
        method: np.array([rows[unit].value if unit in rows else np.nan for unit in units])
        for method, rows in found.items()
    }
    return units, values, next(iter(next(iter(found.values())).values())).better


def rank_runs(runs: Sequence[Results], metric: str, window: str = MEAN) -> Ranking:
    """Ranks the methods of several runs, with ties where the difference is not significant.

    Raises:
        InputError: as `unit_values`, or a metric without a better direction.
    """
    _, values, better = unit_values(runs, metric, window)
    return rank_methods(values, better)


def _add(rows: dict[Unit, Row], unit: Unit, row: Row) -> None:
    if unit in rows:
        case, seed = unit
        raise InputError(f"case {case} with seed {seed} is in two runs: give each once")
    rows[unit] = row
