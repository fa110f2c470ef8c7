"""Slow twin of `eval.metrics` and `eval.curves`: pixel by pixel, from the formulae."""

from __future__ import annotations

import math


def all_metrics(depth, mask, truth, valid, baseline_focal):
    """Every metric by name, over the pixels where mask and valid both hold."""
    rows, columns = depth.shape
    pixels = [(i, j) for i in range(rows) for j in range(columns)]
    pairs = [
        (float(depth[i, j]), float(truth[i, j])) for i, j in pixels if mask[i, j] and valid[i, j]
    ]
    truth_count = sum(bool(valid[i, j]) for i, j in pixels)
    return {**_errors(pairs, baseline_focal), **_shares(pairs, truth_count, baseline_focal)}


def _errors(pairs, baseline_focal):
    n = len(pairs)
    absolute = sorted(abs(e - g) for e, g in pairs)
    middle = (absolute[(n - 1) // 2] + absolute[n // 2]) / 2
    d = [math.log(g) - math.log(e) for e, g in pairs]
    mean_square = sum(x * x for x in d) / n
    return {
        "points": n,
        "mean_error": sum(absolute) / n,
        "median_error": middle,
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
        precision, recall = 100 * hits / n, 100 * hits / truth_count
        shares[f"precision_{cm}cm"], shares[f"recall_{cm}cm"] = precision, recall
        both = precision + recall
        shares[f"f1_{cm}cm"] = 2 * precision * recall / both if both else 0.0
    return shares
