"""Error against coverage: what the surest pixels of a method are worth, as more are admitted.

The confidence threshold is swept over the pixels that a method reports. Pixels of one confidence
enter together, so the curve does not depend on their order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from eval.metrics import FloatArray, Metric, Pairs

COVERAGES_PERCENT: tuple[int, ...] = (1, 2, 5, 10, 20)
NAN = float("nan")


@dataclass(frozen=True, slots=True)
class CoverageCurve:
    """Mean error of the pixels above each confidence threshold, from the surest on.

    Attributes:
        points: (K,) pixels admitted, growing to all that are reported.
        coverage: (K,) the same as share of the ground truth, %.
        mean_error_m: (K,) mean |e - g| of those pixels, m.
        best_error_m: (K,) the least that any order of the same pixels could give, m.
    """

    points: FloatArray
    coverage: FloatArray
    mean_error_m: FloatArray
    best_error_m: FloatArray


def coverage_curve(pairs: Pairs) -> CoverageCurve | None:
    """Sweeps the confidence threshold; None without confidence or estimates."""
    if pairs.confidence is None or not pairs.count:
        return None
    order = np.argsort(-pairs.confidence, kind="stable")
    falling = pairs.confidence[order]
    last = np.append(falling[1:] != falling[:-1], True)
    points = (np.flatnonzero(last) + 1).astype(np.float64)
    mean_m: FloatArray = np.cumsum(pairs.error_m[order])[last] / points
    best_m: FloatArray = np.cumsum(np.sort(pairs.error_m))[last] / points
    return CoverageCurve(points, 100 * points / pairs.truth_count, mean_m, best_m)


def _area(pairs: Pairs) -> float:
    found = coverage_curve(pairs)
    return NAN if found is None else _mean_over_points(found.points, found.mean_error_m)


def _excess(pairs: Pairs) -> float:
    found = coverage_curve(pairs)
    if found is None:
        return NAN
    # Rounding may put a curve that has no excess a hair below the best one.
    return max(0.0, _mean_over_points(found.points, found.mean_error_m - found.best_error_m))


def _mean_over_points(points: FloatArray, values: FloatArray) -> float:
    return float(np.sum(np.diff(points, prepend=0.0) * values) / points[-1])


def _at(pairs: Pairs, percent: int) -> float:
    found = coverage_curve(pairs)
    if found is None or found.coverage[-1] < percent:
        return NAN
    return float(found.mean_error_m[np.argmax(found.coverage >= percent)])


def _at_metric(percent: int) -> Metric:
    name, title = f"mean_error_top_{percent}pct", f"mean error of surest {percent} %"
    formula = f"mean |e - g| of the surest pixels that cover {percent} % of g"
    compute = partial(_at, percent=percent)
    return Metric(name, title, "m", "lower", formula, compute, pooling="order")


COVERAGE_METRICS: tuple[Metric, ...] = (
    Metric(
        "aurc",
        "AURC",
        "m",
        "lower",
        "area under mean |e - g| against share of #e admitted",
        _area,
        pooling="order",
    ),
    Metric(
        "ause",
        "AUSE",
        "m",
        "lower",
        "aurc less that of the pixels in order of error",
        _excess,
        pooling="order",
    ),
    *(_at_metric(percent) for percent in COVERAGES_PERCENT),
)
