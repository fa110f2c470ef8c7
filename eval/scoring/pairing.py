"""Estimates beside ground truth: which pixels are compared, for every method alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.eval.scoring.metrics import OUTLIER_RELATIVE_ERROR, Pairs, cell_offset
from eventsweep.eval.scoring.regions import away_from_border

REFERENCE = "Alg1/H"
"""The method that others are compared with, on the pixels that both report."""
ALL, COMMON, EQUAL, SHARED, HARMONIC = "all", "common", "equal", "shared", "harmonic"
COMPARED: dict[str, str] = {
    COMMON: "the pixels that all methods of the window report",
    EQUAL: "the method's surest pixels, as many as the method with the fewest has",
    SHARED: f"the pixels that the method and {REFERENCE} both report",
    HARMONIC: f"{REFERENCE}'s depth at the pixels that the method reports, too",
}
"""Regions that are no property of the truth, but of several methods."""
OF_ALL_METHODS = (COMMON, EQUAL)
"""Those that are decided by every method of the window."""
DepthImage = NDArray[np.floating]
MaskImage = NDArray[np.bool_]


class Estimate(NamedTuple):
    """What a method says of one view; a plain pair of the first two will do.

    Attributes:
        depth_m: (H, W) estimated z-depth, m.
        mask: (H, W) where the method reports a depth.
        confidence: (H, W) larger where it is surer; None where it does not say.
        rho: (P,) inverse depths of the planes that were swept, 1/m; None where there are none.
    """

    depth_m: DepthImage
    mask: MaskImage
    confidence: NDArray[np.floating] | None = None
    rho: NDArray[np.floating] | None = None


AnyEstimate = Estimate | tuple[DepthImage, MaskImage]


@dataclass(frozen=True, slots=True)
class Truth:
    """Ground truth in the reference view, and the rig that disparities refer to.

    Attributes:
        depth_m: (H, W) true z-depth, m.
        valid: (H, W) where it is known.
        focal_px: focal length of the reference view, px.
        baseline_m: distance between the two cameras, m; None for a rig of one.
        limits_m: closed range of true depths that are scored, m.
        border_px: how many rows and columns at each end of the image are left out.
        regions: (H, W) masks by name, see `eval.scoring.regions`.
    """

    depth_m: DepthImage
    valid: MaskImage
    focal_px: float
    baseline_m: float | None = None
    limits_m: tuple[float, float] = (0.0, float("inf"))
    border_px: int = 0
    regions: Mapping[str, MaskImage] = field(default_factory=dict)

    @property
    def scored(self) -> MaskImage:
        """(H, W) pixels that are scored: valid, finite, within the limits, not in the border."""
        near_m, far_m = self.limits_m
        depth_m = np.where(self.valid, self.depth_m, np.nan)
        known = np.isfinite(depth_m) & (depth_m > 0)
        known &= away_from_border(depth_m.shape, self.border_px)
        return known & (depth_m >= near_m) & (depth_m <= far_m)

    @property
    def baseline_focal_px_m(self) -> float:
        """Baseline times focal length, px·m; NaN without a second camera."""
        return float("nan") if self.baseline_m is None else self.focal_px * self.baseline_m


@dataclass(frozen=True, slots=True)
class MethodPairs:
    """One method's pairs, by region.

    Attributes:
        own: at all pixels that it reports.
        common: at those that all compared methods report; None for one that is not compared.
        regions: at its own pixels in each region of ground truth; `equal`, at its surest pixels, as
            many as the compared method with the fewest has, where they are known; beside a
            reference method also `shared`, at the pixels that both report, and `harmonic`, the
            reference's pairs there.
        causes: why its bad pixels are bad, see `eval.scoring.outlier_causes`; None where it was not
            asked.
    """

    own: Pairs
    common: Pairs | None
    regions: Mapping[str, Pairs] = field(default_factory=dict)
    causes: Mapping[str, int] | None = None

    @property
    def by_region(self) -> dict[str, Pairs]:
        """All of them under their regions' names."""
        common = {} if self.common is None else {COMMON: self.common}
        return {ALL: self.own, **common, **self.regions}


def pair(
    depth_m: DepthImage,
    mask: MaskImage,
    truth: Truth,
    *,
    region: MaskImage | None = None,
    confidence: NDArray[np.floating] | None = None,
    rho: NDArray[np.floating] | None = None,
) -> Pairs:
    """Collects estimate and truth where both are valid, in float64.

    Images are (H, W) and of one view; `region` says which part of the truth counts, None for all of
    it; `rho` holds the planes that were swept, 1/m.

    Raises:
        InputError: images of different shape, a reported depth that is not finite and positive,
            or a focal length or baseline that is not.
    """
    _check(depth_m, mask, truth)
    scored = truth.scored if region is None else truth.scored & region
    both = mask & scored
    estimate_m, truth_m = depth_m[both].astype(np.float64), truth.depth_m[both].astype(np.float64)
    return Pairs(
        estimate_m,
        truth_m,
        int(np.count_nonzero(scored)),
        truth.baseline_focal_px_m,
        None if rho is None else cell_offset(estimate_m, truth_m, rho),
        None if confidence is None else confidence[both].astype(np.float64),
    )


def pair_methods(
    estimates: Mapping[str, AnyEstimate], truth: Truth, *, compared: Iterable[str] | None = None,
    reference: str | None = None,
) -> dict[str, MethodPairs]:  # fmt: skip
    """Pairs every method with the truth, and again by region and on the pixels others report.

    A method without a single point is left out of the common support, which it would empty, and of
    the fewest points.

    Args:
        estimates: by method.
        truth: ground truth of the same view.
        compared: the methods whose pixels make the common support and the fewest points; None for
            all.
        reference: the method that every other is paired with; None, or one that is not there, for
            no pairs.
    """
    full = {method: Estimate(*estimate) for method, estimate in estimates.items()}
    within = set(full if compared is None else compared)
    filled = [one.mask for name, one in full.items() if name in within and one.mask.any()]
    common = np.logical_and.reduce(filled) if filled else np.zeros(truth.valid.shape, np.bool_)
    other = full.get(reference) if reference is not None else None
    own = {method: _pair(one, truth) for method, one in full.items()}
    fewest = min((own[name].count for name in within if own[name].count), default=0)
    return {
        method: MethodPairs(
            own[method],
            _pair(one, truth, common) if method in within else None,
            {
                **{name: _pair(one, truth, region) for name, region in truth.regions.items()},
                **(_equal(own[method], fewest) if method in within else {}),
                **(_beside(one, other, truth) if other is not None and method != reference else {}),
            },
        )
        for method, one in full.items()
    }


def surest(pairs: Pairs, count: int) -> Pairs | None:
    """The `count` pairs of the highest confidence; None where nothing says which those are.

    Of equal confidences some are drawn: the first ones would lie in the same rows of the image.
    """
    if count >= pairs.count:
        return pairs
    if pairs.confidence is None:
        return None
    drawn = np.random.default_rng(0).permutation(pairs.count)
    kept = np.sort(np.lexsort((drawn, -pairs.confidence))[:count])
    cells = pairs.signed_cells
    return replace(
        pairs, estimate_m=pairs.estimate_m[kept], truth_m=pairs.truth_m[kept],
        signed_cells=None if cells is None else cells[kept], confidence=pairs.confidence[kept],
    )  # fmt: skip


def _equal(own: Pairs, count: int) -> dict[str, Pairs]:
    found = surest(own, count)
    return {} if found is None else {EQUAL: found}


def _pair(estimate: Estimate, truth: Truth, within: MaskImage | None = None) -> Pairs:
    depth_m, mask, confidence, rho = estimate
    return pair(depth_m, mask, truth, region=within, confidence=confidence, rho=rho)


def _beside(one: Estimate, other: Estimate, truth: Truth) -> dict[str, Pairs]:
    return {SHARED: _pair(one, truth, other.mask), HARMONIC: _pair(other, truth, one.mask)}


def bad_pixels(estimate: AnyEstimate, truth: Truth) -> MaskImage:
    """(H, W) pixels with an estimate that is off by more than a tenth of the truth."""
    both = estimate[1] & truth.scored
    bad = np.zeros(both.shape, np.bool_)
    truth_m = truth.depth_m[both].astype(np.float64)
    error_m = np.abs(estimate[0][both].astype(np.float64) - truth_m)
    bad[both] = error_m / truth_m > OUTLIER_RELATIVE_ERROR
    return bad


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
