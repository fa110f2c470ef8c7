"""From depth maps and ground truth to rows: per window, pooled over pixels, and averaged."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from eval.bootstrap import intervals
from eval.case_pool import CasePool
from eval.method_scores import ALL_METRICS, COMMON_PREFIX, Score, score_method, score_pairs
from eval.pairing import (
    DepthImage,
    Estimate,
    MaskImage,
    MethodPairs,
    Truth,
    pair,
    pair_methods,
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

Windows = Mapping[str, Mapping[str, MethodPairs]] | Iterable[tuple[str, Mapping[str, MethodPairs]]]


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


def case_rows(case: str, windows: Windows, *, seed: int = 0) -> list[Row]:
    """The rows of one case: each window, then window `all`, then window `mean`.

    Args:
        case: name of the case.
        windows: names of windows and each method's pairs there; one after another, if they come
            from a generator, so that memory holds one window's pixels.
        seed: of the bootstrap.

    Raises:
        InputError: windows of several rigs, or no room on the disk for what is pooled.
    """
    single: list[list[Row]] = []
    with CasePool() as pool:
        for name, methods in windows.items() if isinstance(windows, Mapping) else windows:
            scores = {method: score_method(pairs) for method, pairs in methods.items()}
            pool.add(methods, scores)
            single.append(list(_rows(case, name, scores)))
        pooled = list(_rows(case, POOLED, pool.scores()))
    rows = [row for found in single for row in found]
    return [*rows, *pooled, *mean_rows(single, seed=seed)]


def _rows(case: str, window: str, methods: Mapping[str, Iterable[Score]]) -> Iterator[Row]:
    for method, scores in methods.items():
        for score in scores:
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
