"""Confidence intervals by hierarchical bootstrap: over seeds, and over the windows of each.

Windows of one sequence share its scene and motion, so they are not independent draws. Resampling
draws seeds first and then windows within each seed drawn (Davison & Hinkley, Bootstrap Methods and
their Application, 1997, section 3.8). The statistic is the mean in which every seed weighs the
same, and within a seed every window.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError

RESAMPLES = 2000
LEVEL = 0.95

Floats = NDArray[np.float64]


def interval(
    groups: Sequence[NDArray[np.floating]],
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> tuple[float, float]:
    """Returns the percentile interval of the mean.

    Args:
        groups: per seed, the values of its windows.
        level: share of resampled means inside.
        resamples: how many.
        seed: of the drawing; the same gives the same interval.

    Returns:
        Lower and upper end; NaN where fewer than two values are given or one is undefined.

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
        level: share of resampled means inside.
        resamples: how many.
        seed: of the drawing.

    Returns:
        (M,) lower and upper ends.

    Raises:
        InputError: sizes that do not add up to N, an empty group, or an impossible level or count.
    """
    if sum(sizes) != len(values) or min(sizes, default=1) < 1:
        raise InputError(
            f"groups of {list(sizes)} for {len(values)} values: each needs one or more"
        )
    if not 0 < level < 1 or resamples < 1:
        raise InputError(f"level {level:g} with {resamples} resamples: needs 0 < level < 1 and 1")
    if len(values) < 2:
        nothing = np.full(values.shape[1], np.nan)
        return nothing, nothing.copy()
    # A product of whole rows; not BLAS, whose rounding may depend on the number of threads.
    means = np.einsum("bn,nm->bm", weights(sizes, resamples, seed), values, optimize=False)
    tail = (1 - level) / 2
    low, high = np.quantile(means, [tail, 1 - tail], axis=0)
    return low, high


def weights(sizes: Sequence[int], resamples: int, seed: int) -> Floats:
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
