"""Error against coverage; precision, recall and F1 against the error that is tolerated.

The confidence threshold is swept over the pixels that a method reports. Pixels of one confidence
enter together, so the curve does not depend on their order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.eval.scoring.metrics import NAN, FloatArray, Metric, Pairs, Pooling

THRESHOLDS_CM: tuple[int, ...] = tuple(range(1, 16))
THRESHOLDS_PERCENT: tuple[int, ...] = (1, 2, 5, 10, 20)
Errors = Callable[[Pairs], FloatArray]
Hits = NDArray[Any]
Share = Callable[[Pairs, Hits], float]
COVERAGES_PERCENT: tuple[int, ...] = (1, 2, 5, 10, 20)


def _precision(pairs: Pairs, hits: Hits) -> float:
    return 100 * float(np.sum(hits)) / pairs.count


def _recall(pairs: Pairs, hits: Hits) -> float:
    return 100 * float(np.sum(hits)) / pairs.truth_count if pairs.truth_count else np.nan


def _f1(pairs: Pairs, hits: Hits) -> float:
    # 2PR/(P+R) with the quotients cleared: defined, and zero, where nothing was estimated.
    either = pairs.count + pairs.truth_count
    return 200 * float(np.sum(hits)) / either if either else np.nan


def _metres(pairs: Pairs) -> FloatArray:
    return pairs.error_m


def _relative(pairs: Pairs) -> FloatArray:
    return pairs.error_m / pairs.truth_m


def _within(pairs: Pairs, share: Share, *, errors: Errors, threshold: float) -> float:
    return share(pairs, errors(pairs) < threshold)


def _area(pairs: Pairs, share: Share, *, errors: Errors, largest: float) -> float:
    """Integrates a share over thresholds from 0 to `largest`, divided by `largest`.

    Exact, without sampling: a pixel of error d counts from d on, so it adds 1 - d / largest.
    """
    return share(pairs, np.clip(1 - errors(pairs) / largest, 0, 1))


_SHARES: tuple[tuple[str, str, str, Share, Pooling], ...] = (
    ("precision", "precision", "{} / #e", _precision, "pairs"),
    ("recall", "recall", "{} / #g", _recall, "truth"),
    ("f1", "F1", "2 {} / (#e + #g)", _f1, "either"),
)


def _three(key: str, title: str, hits: str, compute: Callable[..., float]) -> tuple[Metric, ...]:
    """Precision, recall and F1 of one threshold or range; `key` and `title` have a gap for them."""
    return tuple(
        Metric(
            key.format(name),
            title.format(word),
            "%",
            "higher",
            formula.format(hits),
            partial(compute, share=share),
            needs_pairs=name == "precision",
            pooling=pooling,
        )
        for name, word, formula, share, pooling in _SHARES
    )


def _at_cm(cm: int) -> tuple[Metric, ...]:
    compute = partial(_within, errors=_metres, threshold=cm / 100)
    return _three(f"{{}}_{cm}cm", f"{{}} at {cm} cm", f"#(|e - g| < {cm} cm)", compute)


def _at_percent(percent: int) -> tuple[Metric, ...]:
    compute = partial(_within, errors=_relative, threshold=percent / 100)
    hits = f"#(|e - g| / g < {percent} %)"
    return _three(f"{{}}_{percent}pct", f"{{}} at {percent} %", hits, compute)


_LARGEST_CM, _LARGEST_PERCENT = THRESHOLDS_CM[-1], THRESHOLDS_PERCENT[-1]


CURVE_METRICS: tuple[Metric, ...] = (
    *(metric for cm in THRESHOLDS_CM for metric in _at_cm(cm)),
    *(metric for percent in THRESHOLDS_PERCENT for metric in _at_percent(percent)),
    *_three(
        "auc_{}",
        f"{{}} AUC to {_LARGEST_CM} cm",
        f"(mean over tau in 0..{_LARGEST_CM} cm of #(|e - g| < tau))",
        partial(_area, errors=_metres, largest=_LARGEST_CM / 100),
    ),
    *_three(
        "auc_{}_relative",
        f"{{}} AUC to {_LARGEST_PERCENT} %",
        f"(mean over tau in 0..{_LARGEST_PERCENT} % of #(|e - g| / g < tau))",
        partial(_area, errors=_relative, largest=_LARGEST_PERCENT / 100),
    ),
)


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


def coverage_curve(
    error_m: FloatArray, confidence: FloatArray | None, truth_count: int
) -> CoverageCurve | None:
    """Sweeps the confidence threshold; None without confidence or estimates."""
    if confidence is None or not len(error_m):
        return None
    order = np.argsort(-confidence, kind="stable")
    falling = confidence[order]
    last = np.append(falling[1:] != falling[:-1], True)
    points = (np.flatnonzero(last) + 1).astype(np.float64)
    mean_m: FloatArray = np.cumsum(error_m[order])[last] / points
    best_m: FloatArray = np.cumsum(np.sort(error_m))[last] / points
    return CoverageCurve(points, 100 * points / truth_count, mean_m, best_m)


def coverage_scores(
    error_m: FloatArray, confidence: FloatArray | None, truth_count: int
) -> dict[str, float]:
    """The metrics of error over coverage; NaN where they are undefined."""
    found = coverage_curve(error_m, confidence, truth_count)
    if found is None:
        return {metric.name: NAN for metric in COVERAGE_METRICS}
    excess = _mean_over_points(found.points, found.mean_error_m - found.best_error_m)
    return {
        "aurc": _mean_over_points(found.points, found.mean_error_m),
        # Rounding may put a curve that has no excess a hair below the best one.
        "ause": max(0.0, excess),
        **{_top(percent): _at(found, percent) for percent in COVERAGES_PERCENT},
    }


def _coverage_score(pairs: Pairs, name: str) -> float:
    return coverage_scores(pairs.error_m, pairs.confidence, pairs.truth_count)[name]


def _mean_over_points(points: FloatArray, values: FloatArray) -> float:
    return float(np.sum(np.diff(points, prepend=0.0) * values) / points[-1])


def _at(found: CoverageCurve, percent: int) -> float:
    if found.coverage[-1] < percent:
        return NAN
    return float(found.mean_error_m[np.argmax(found.coverage >= percent)])


def _top(percent: int) -> str:
    return f"mean_error_top_{percent}pct"


def _coverage_metric(name: str, title: str, formula: str) -> Metric:
    compute = partial(_coverage_score, name=name)
    return Metric(name, title, "m", "lower", formula, compute, pooling="order")


def _at_metric(percent: int) -> Metric:
    title = f"mean error of surest {percent} %"
    formula = f"mean |e - g| of the surest pixels that cover {percent} % of g"
    return _coverage_metric(_top(percent), title, formula)


COVERAGE_METRICS: tuple[Metric, ...] = (
    _coverage_metric("aurc", "AURC", "area under mean |e - g| against share of #e admitted"),
    _coverage_metric("ause", "AUSE", "aurc less that of the pixels in order of error"),
    *(_at_metric(percent) for percent in COVERAGES_PERCENT),
)
