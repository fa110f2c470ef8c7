"""From depth maps and ground truth to rows: per window, pooled over pixels, and averaged."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from eval.bootstrap import intervals
from eval.method_scores import ALL_METRICS, COMMON_PREFIX, Score, score_method, score_pairs
from eval.pairing import (
    DepthImage,
    Estimate,
    MaskImage,
    MethodPairs,
    Truth,
    pair,
    pair_methods,
    pooled_methods,
)
from eval.results import Row

__all__ = [
    "ALL_METRICS",
    "COMMON_PREFIX",
    "MEAN",
    "POOLED",
    "Estimate",
    "MethodPairs",
    "Score",
    "Truth",
    "case_rows",
    "mean_rows",
    "pair",
    "pair_methods",
    "score_depth",
    "score_method",
    "score_pairs",
]

POOLED = "all"
MEAN = "mean"


def score_depth(
    depth_m: DepthImage,
    mask: MaskImage,
    truth_depth_m: DepthImage,
    truth_valid: MaskImage,
    focal_px: float,
    baseline_m: float | None,
    limits_m: tuple[float, float] = (0.0, float("inf")),
) -> list[Score]:
    """Scores one depth map by every metric.

    Args:
        depth_m: (H, W) estimated z-depth, m.
        mask: (H, W) where the method reports a depth.
        truth_depth_m: (H, W) true z-depth, m.
        truth_valid: (H, W) where the truth is known.
        focal_px: focal length of the view, px.
        baseline_m: distance between the two cameras, m; None leaves disparity metrics NaN.
        limits_m: closed range of true depths that are scored, m.

    Raises:
        InputError: images of different shape, a reported depth that is not finite and positive,
            or a focal length or baseline that is not.
    """
    truth = Truth(truth_depth_m, truth_valid, focal_px, baseline_m, limits_m)
    return score_pairs(pair(depth_m, mask, truth))


def case_rows(
    case: str, windows: Mapping[str, Mapping[str, MethodPairs]], *, seed: int = 0
) -> list[Row]:
    """The rows of one case: each window, then window `all`, then window `mean`.

    Args:
        case: name of the case.
        windows: per window name, each method's pairs.
        seed: of the bootstrap.
    """
    single = [list(_rows(case, name, methods.items())) for name, methods in windows.items()]
    pooled = _rows(case, POOLED, pooled_methods(list(windows.values())).items())
    rows = [row for found in single for row in found]
    return [*rows, *pooled, *mean_rows(single, seed=seed)]


def _rows(case: str, window: str, methods: Iterable[tuple[str, MethodPairs]]) -> Iterator[Row]:
    for method, pairs in methods:
        for score in score_method(pairs):
            yield Row(
                case, window, method, score.metric, score.value, score.unit, score.better,
                score.region, score.points,
            )  # fmt: skip


def mean_rows(windows: Sequence[Sequence[Row]], *, seed: int = 0) -> list[Row]:
    """Averages windows of one case, every window weighing the same, with 95 % intervals.

    A number that a window lacks or leaves undefined is undefined here: an average over fewer
    windows would not be comparable between methods.

    Args:
        windows: the rows of each window.
        seed: of the bootstrap over windows.
    """
    tables = [{(row.method, row.metric): row for row in rows} for rows in windows]
    keys = list(dict.fromkeys(key for table in tables for key in table))
    found = [[table.get(key) for key in keys] for table in tables]
    values = np.array([[math.nan if row is None else row.value for row in rows] for rows in found])
    if not values.size:
        return []
    means = values.mean(axis=0)
    lows, highs = intervals(values, [len(values)], seed=seed)
    first = [next(table[key] for table in tables if key in table) for key in keys]
    points = [_total(rows) for rows in zip(*found, strict=True)]
    numbers = zip(first, means, lows, highs, points, strict=True)
    return [
        replace(
            row, window=MEAN, value=float(mean), points=total, low=_known(low), high=_known(high)
        )
        for row, mean, low, high, total in numbers
    ]


def _total(rows: Sequence[Row | None]) -> int | None:
    counts = [row.points for row in rows if row is not None and row.points is not None]
    return sum(counts) if len(counts) == len(rows) else None


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
