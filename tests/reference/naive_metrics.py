"""Slow twins of the metrics, of the curves and of pooling, from the formulae."""

import itertools
import math

import numpy as np

from eventsweep.eval.scoring.metrics import Pairs
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.scoring.pairing import MethodPairs


def all_metrics(depth, mask, truth, valid, baseline_focal, confidence, rho):
    """Every metric by name, over the pixels where mask and valid both hold."""
    rows, columns = depth.shape
    pixels = [(i, j) for i in range(rows) for j in range(columns)]
    pairs = [
        (float(depth[i, j]), float(truth[i, j])) for i, j in pixels if mask[i, j] and valid[i, j]
    ]
    truth_count = sum(bool(valid[i, j]) for i, j in pixels)
    sure = [float(confidence[i, j]) for i, j in pixels if mask[i, j] and valid[i, j]]
    return {
        **_errors(pairs, baseline_focal),
        **_shares(pairs, truth_count, baseline_focal),
        **_cells(pairs, [float(r) for r in rho]),
        **_areas(pairs, truth_count),
        **_coverage(pairs, sure, truth_count),
    }


def _errors(pairs, baseline_focal):
    n = len(pairs)
    absolute = sorted(abs(e - g) for e, g in pairs)
    d = [math.log(g) - math.log(e) for e, g in pairs]
    mean_square = sum(x * x for x in d) / n
    return {
        "points": n,
        "mean_error": sum(absolute) / n,
        "median_error": _median(absolute),
        "bias": _median([e - g for e, g in pairs]),
        "bias_px": _median([(g - e) / (e * g) * baseline_focal for e, g in pairs]),
        "rmse": math.sqrt(sum(x * x for x in absolute) / n),
        "abs_rel": 100 * sum(abs(e - g) / g for e, g in pairs) / n,
        "aerr_r": 100 * sum(abs(e - g) / e for e, g in pairs) / n,
        "silog": 100 * (mean_square - (sum(d) / n) ** 2),
        "log_rmse": 100 * math.sqrt(mean_square),
    }


def _shares(pairs, truth_count, baseline_focal):
    n = len(pairs)

    def share(condition):
        return 100 * sum(1 for e, g in pairs if condition(e, g)) / n

    def disparity_error(e, g):
        return abs(1 / e - 1 / g) * baseline_focal

    shares = {
        "completeness": 100 * n / truth_count,
        "outlier_share": share(lambda e, g: abs(e - g) / g > 0.10),
        "bad_published": share(
            lambda e, g: disparity_error(e, g) > 5 and abs(e - g) / e > 0.05,
        ),
    }
    for px in (1, 2, 3, 5):
        shares[f"bad_{px}px"] = share(lambda e, g, px=px: disparity_error(e, g) > px)
    for k in (1, 2, 3):
        shares[f"delta_{k}"] = share(lambda e, g, k=k: max(e / g, g / e) < 1.25**k)
    for cm in range(1, 16):
        hits = sum(1 for e, g in pairs if abs(e - g) < cm / 100)
        shares |= _three(hits, n, truth_count, f"{{}}_{cm}cm")
    for percent in (1, 2, 5, 10, 20):
        hits = sum(1 for e, g in pairs if abs(e - g) / g < percent / 100)
        shares |= _three(hits, n, truth_count, f"{{}}_{percent}pct")
    return shares


def _three(hits, n, truth_count, name):
    precision, recall = 100 * hits / n, 100 * hits / truth_count
    both = precision + recall
    f1 = 2 * precision * recall / both if both else 0.0
    return {name.format(k): v for k, v in zip(SHARES, (precision, recall, f1), strict=True)}


SHARES = ("precision", "recall", "f1")


def _areas(pairs, truth_count):
    """Integrates the staircases of precision, recall and F1 from step to step."""
    found = {}
    for name, largest, errors in (
        ("auc_{}", 0.15, [abs(e - g) for e, g in pairs]),
        ("auc_{}_relative", 0.20, [abs(e - g) / g for e, g in pairs]),
    ):
        steps = sorted({0.0, largest, *(x for x in errors if x < largest)})
        total = dict.fromkeys(SHARES, 0.0)
        for left, right in itertools.pairwise(steps):
            hits = sum(1 for x in errors if x <= left)
            for key, value in _three(hits, len(errors), truth_count, "{}").items():
                total[key] += value * (right - left) / largest
        found |= {name.format(key): value for key, value in total.items()}
    return found


def _cells(pairs, rho):
    planes = sorted(rho)

    def position(r):
        k = sum(1 for plane in planes if plane <= r) - 1
        k = min(max(k, 0), len(planes) - 2)
        return k + (r - planes[k]) / (planes[k + 1] - planes[k])

    offsets = [position(1 / e) - position(1 / g) for e, g in pairs]
    between = sorted(map(abs, offsets))
    n = len(between)
    found = {f"bad_{c}cell": 100 * sum(1 for x in between if x > c) / n for c in (1, 2, 5)}
    found |= {"mean_cells": sum(between) / n, "median_cells": _median(between)}
    return {**found, "bias_cells": _median(offsets)}


def _median(numbers):
    ordered, n = sorted(numbers), len(numbers)
    return (ordered[(n - 1) // 2] + ordered[n // 2]) / 2


def _coverage(pairs, sure, truth_count):
    """Admits one confidence after the other, asking all pixels each time."""
    errors = [abs(e - g) for e, g in pairs]
    n = len(errors)
    kept, area, best = [], 0.0, 0.0
    for threshold in sorted(set(sure), reverse=True):
        inside = [x for x, c in zip(errors, sure, strict=True) if c >= threshold]
        new = len(inside) - (kept[-1][0] if kept else 0)
        kept.append((len(inside), sum(inside) / len(inside)))
        area += new / n * kept[-1][1]
        best += new / n * sum(sorted(errors)[: len(inside)]) / len(inside)
    found = {"aurc": area, "ause": area - best}
    for percent in (1, 2, 5, 10, 20):
        enough = [mean for count, mean in kept if 100 * count / truth_count >= percent]
        found[f"mean_error_top_{percent}pct"] = enough[0] if enough else math.nan
    return found


def pooled(parts):
    """The pairs of several windows as one large window's, all in memory."""

    def joined(columns):
        columns = list(columns)
        return None if any(column is None for column in columns) else np.concatenate(columns)

    return Pairs(
        joined(part.estimate_m for part in parts), joined(part.truth_m for part in parts),
        sum(part.truth_count for part in parts), parts[0].baseline_focal_px_m,
        joined(part.signed_cells for part in parts), joined(part.confidence for part in parts),
    )  # fmt: skip


def pooled_methods(parts):
    """One method's pairs of several windows by region, without regions that a window lacks."""
    names = [name for name in parts[0].regions if all(name in part.regions for part in parts)]
    causes = None
    if all(part.causes is not None for part in parts):
        causes = {cause: sum(part.causes[cause] for part in parts) for cause in CAUSES}
    return MethodPairs(
        pooled([part.own for part in parts]),
        None if parts[0].common is None else pooled([part.common for part in parts]),
        {name: pooled([part.regions[name] for part in parts]) for name in names},
        causes,
    )
