"""Precision, recall and F1 against the error that is tolerated, 1 cm to 15 cm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eval.metrics import FloatArray, Metric, Pairs

THRESHOLDS_CM: tuple[int, ...] = tuple(range(1, 16))


@dataclass(frozen=True, slots=True)
class Curve:
    """What share is right, as the tolerated error grows.

    Attributes:
        threshold_cm: (15,) tolerated error |e - g|, cm.
        precision: (15,) share of the estimates that are within it, %.
        recall: (15,) share of the ground truth that has an estimate within it, %.
        f1: (15,) harmonic mean of both, %.
    """

    threshold_cm: NDArray[np.int64]
    precision: FloatArray
    recall: FloatArray
    f1: FloatArray


def curve(pairs: Pairs) -> Curve:
    """Precision, recall and F1 at every whole centimetre from 1 to 15."""
    return Curve(
        np.array(THRESHOLDS_CM),
        np.array([_precision(pairs, cm) if pairs.count else np.nan for cm in THRESHOLDS_CM]),
        np.array([_recall(pairs, cm) for cm in THRESHOLDS_CM]),
        np.array([_f1(pairs, cm) for cm in THRESHOLDS_CM]),
    )


def _hits(pairs: Pairs, threshold_cm: int) -> int:
    return int(np.count_nonzero(pairs.error_m < threshold_cm / 100))


def _precision(pairs: Pairs, threshold_cm: int) -> float:
    return 100 * _hits(pairs, threshold_cm) / pairs.count


def _recall(pairs: Pairs, threshold_cm: int) -> float:
    return 100 * _hits(pairs, threshold_cm) / pairs.truth_count if pairs.truth_count else np.nan


def _f1(pairs: Pairs, threshold_cm: int) -> float:
    # 2PR/(P+R) with the quotients cleared: defined, and zero, where nothing was estimated.
    either = pairs.count + pairs.truth_count
    return 200 * _hits(pairs, threshold_cm) / either if either else np.nan


def _at(cm: int) -> tuple[Metric, Metric, Metric]:
    hits, where = f"#(|e - g| < {cm} cm)", f"at {cm} cm"
    precision = _share(f"precision_{cm}cm", f"precision {where}", f"{hits} / #e", _precision, cm)
    recall = _share(f"recall_{cm}cm", f"recall {where}", f"{hits} / #g", _recall, cm)
    f1 = _share(f"f1_{cm}cm", f"F1 {where}", f"2 {hits} / (#e + #g)", _f1, cm)
    return precision, replace(recall, needs_pairs=False), replace(f1, needs_pairs=False)


def _share(
    name: str, title: str, formula: str, share: Callable[[Pairs, int], float], cm: int
) -> Metric:
    return Metric(name, title, "%", "higher", formula, lambda pairs: share(pairs, cm))


CURVE_METRICS: tuple[Metric, ...] = tuple(metric for cm in THRESHOLDS_CM for metric in _at(cm))
