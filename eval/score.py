"""From depth maps and ground truth to rows of scores."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from eval.curves import CURVE_METRICS
from eval.metrics import METRICS, Better, Metric, Pairs, pooled
from eval.results import Row

POOLED = "all"
COMMON_PREFIX = "common_"
_COMMON_NAMES = ("points", "mean_error", "median_error", "bad_published")
ALL_METRICS: dict[str, Metric] = {metric.name: metric for metric in (*METRICS, *CURVE_METRICS)}

DepthImage = NDArray[np.floating]
MaskImage = NDArray[np.bool_]
Estimate = tuple[DepthImage, MaskImage]


@dataclass(frozen=True, slots=True)
class Score:
    """One number about one depth map."""

    metric: str
    value: float
    unit: str
    better: Better


@dataclass(frozen=True, slots=True)
class Truth:
    """Ground truth in the reference view, and the rig that disparities refer to.

    Attributes:
        depth_m: (H, W) true z-depth, m.
        valid: (H, W) where it is known.
        focal_px: focal length of the reference view, px.
        baseline_m: distance between the two cameras, m; None for a rig of one.
        limits_m: closed range of true depths that are scored, m.
    """

    depth_m: DepthImage
    valid: MaskImage
    focal_px: float
    baseline_m: float | None = None
    limits_m: tuple[float, float] = (0.0, float("inf"))

    @property
    def scored(self) -> MaskImage:
        """(H, W) pixels that are scored: valid, finite, positive and within the limits."""
        near_m, far_m = self.limits_m
        depth_m = np.where(self.valid, self.depth_m, np.nan)
        known = np.isfinite(depth_m) & (depth_m > 0)
        return known & (depth_m >= near_m) & (depth_m <= far_m)

    @property
    def baseline_focal_px_m(self) -> float:
        """Baseline times focal length, px·m; NaN without a second camera."""
        return float("nan") if self.baseline_m is None else self.focal_px * self.baseline_m


@dataclass(frozen=True, slots=True)
class MethodPairs:
    """One method's pairs: at its own pixels, and at those that all methods share."""

    own: Pairs
    common: Pairs


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


def pair(depth_m: DepthImage, mask: MaskImage, truth: Truth) -> Pairs:
    """Collects estimate and truth where both are valid, in float64."""
    _check(depth_m, mask, truth)
    scored = truth.scored
    both = mask & scored
    return Pairs(
        depth_m[both].astype(np.float64),
        truth.depth_m[both].astype(np.float64),
        int(np.count_nonzero(scored)),
        truth.baseline_focal_px_m,
    )


def pair_methods(estimates: Mapping[str, Estimate], truth: Truth) -> dict[str, MethodPairs]:
    """Pairs every method with the truth, and again on the pixels that all methods report.

    A method without a single point is left out of the common support, which it would empty.
    """
    filled = [mask for _, mask in estimates.values() if mask.any()]
    shared = np.logical_and.reduce(filled) if filled else np.zeros(truth.valid.shape, np.bool_)
    return {
        method: MethodPairs(pair(depth_m, mask, truth), pair(depth_m, mask & shared, truth))
        for method, (depth_m, mask) in estimates.items()
    }


def score_pairs(pairs: Pairs) -> list[Score]:
    """Every metric of one set of pairs, and the two numbers that put them into proportion."""
    context = [
        Score("truth_points", float(pairs.truth_count), "px", "none"),
        Score("baseline_focal", pairs.baseline_focal_px_m, "px·m", "none"),
    ]
    return context + [_score(metric, pairs) for metric in ALL_METRICS.values()]


def score_method(pairs: MethodPairs) -> list[Score]:
    """Every metric on the method's own pixels, and the few that rank it on the common ones."""
    common = (_score(ALL_METRICS[name], pairs.common, COMMON_PREFIX) for name in _COMMON_NAMES)
    return [*score_pairs(pairs.own), *common]


def case_rows(case: str, windows: Mapping[str, Mapping[str, MethodPairs]]) -> list[Row]:
    """The rows of one case: each window, then all windows pooled over pixels as window `all`.

    Args:
        case: name of the case.
        windows: per window name, each method's pairs.
    """
    rows = [row for name, methods in windows.items() for row in _rows(case, name, methods.items())]
    return rows + list(_rows(case, POOLED, _pool(list(windows.values()))))


def _pool(windows: Sequence[Mapping[str, MethodPairs]]) -> Iterator[tuple[str, MethodPairs]]:
    for method in windows[0] if windows else ():
        parts = [window[method] for window in windows]
        own, common = pooled([part.own for part in parts]), pooled([part.common for part in parts])
        yield method, MethodPairs(own, common)


def _rows(case: str, window: str, methods: Iterable[tuple[str, MethodPairs]]) -> Iterator[Row]:
    for method, pairs in methods:
        for score in score_method(pairs):
            yield Row(case, window, method, score.metric, score.value, score.unit, score.better)


def _score(metric: Metric, pairs: Pairs, prefix: str = "") -> Score:
    return Score(prefix + metric.name, metric(pairs), metric.unit, metric.better)


def _check(depth_m: DepthImage, mask: MaskImage, truth: Truth) -> None:
    shapes = {array.shape for array in (depth_m, mask, truth.depth_m, truth.valid)}
    if len(shapes) != 1:
        raise InputError(f"images of shapes {sorted(shapes)}: depth, mask and truth must agree")
    reported = depth_m[mask]
    unusable = int(np.count_nonzero(~(np.isfinite(reported) & (reported > 0))))
    if unusable:
        raise InputError(
            f"{unusable} of {reported.size} reported depths are not finite and positive: "
            "clear those pixels in the mask"
        )
    for name, value in (("focal length", truth.focal_px), ("baseline", truth.baseline_m)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} {value}: it must be finite and positive")
