"""The extractions that the study compares, each a depth and as many pixels as Alg1/H reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import confidence_mask, masked_median, without_border
from eventsweep.emvs.depth.focus import (
    FocusConfig,
    FocusEstimate,
    at_least,
    between_the_ends,
    candidate_mask,
    judge_at,
    on_surface,
)
from eventsweep.emvs.dsi import focus_measures
from eventsweep.emvs.dsi.fusion import MEANS, Fusion, fuse
from eventsweep.emvs.dsi.maxima import FocusPeak, Maximum
from study_cache import StudySample

BASE = "Alg1/H"
OURS = "ours"
ALONE = "ours, camera 0 alone"
BEFORE = "variance, agreement × support × inside"  # the three factors that came first
RIVAL_GAP_PLANES = 6
RELIABILITIES = (0.01, 0.02, 0.03, 0.05, 0.1, 0.2)

# The difference of Gaussians filters votes and gathers none: it needs the scale of an edge.
_SCALES_PX = {"variance": 2.5, "mean-square": 2.5, "gradient": 2.5, "laplacian": 2.5, "dog": 0.7}

_OURS = FocusConfig()
_UNFITTED = replace(_OURS, surface_sigma_px=0.1)  # a window of one pixel fits nothing

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class VariantEstimate:
    """(H, W) plane positions, and the pixels that report them."""

    position: Floats
    mask: Mask


@dataclass(frozen=True, eq=False)
class Volumes:
    """One sample's volumes, and what all extractions share.

    Attributes:
        votes: (C, N, H, W) float32.
        fused: (N, H, W) float32 harmonic mean.
        disparity_px: (N,) disparity of each plane, px.
        config: the mapper's defaults.
    """

    votes: Floats
    fused: Floats
    disparity_px: NDArray[np.float64]
    config: MapperConfig

    @classmethod
    def of(cls, sample: StudySample) -> Volumes:
        """Fuses a sample's volumes."""
        rho = sample.view.rho
        fused = fuse(Fusion(MEANS["H"].code), sample.votes)
        disparity_px = sample.truth.baseline_focal_px_m * rho.astype(np.float64)
        return cls(sample.votes, fused, disparity_px, MapperConfig())

    @cached_property
    def maximum(self) -> Maximum:
        """The plain ray maximum of the fused volume."""
        return maximum_of(self.fused)

    @cached_property
    def base(self) -> VariantEstimate:
        """What Alg1/H reports."""
        mask = confidence_mask(self.maximum.value, self.config)
        position = masked_median(self.maximum.position(), mask, self.config.median_px)
        return VariantEstimate(position, without_border(mask, self.config.border_px))

    @cached_property
    def focused(self) -> Floats:
        """(N, H, W) local variance of the fused planes."""
        return np.stack([focus_measures.variance(p, FocusConfig().sigma_px) for p in self.fused])

    def found(self, config: FocusConfig) -> FocusEstimate:
        """Extraction by focus."""
        return found_in_volumes(self.fused, self.votes, self.disparity_px, config)

    def alone(self) -> VariantEstimate:
        """Extraction by focus from camera 0's votes: as `Focus/cam0`, without agreement."""
        own, nobody = self.votes[0], self.votes[:0]
        return self.best(found_in_volumes(own, nobody, self.disparity_px, _OURS))

    def best(self, found: FocusEstimate, reliability: Floats | None = None) -> VariantEstimate:
        """The most reliable pixels, as many as Alg1/H reports."""
        if reliability is not None:
            # `reliability` is a product of both: all of it goes into one
            ones = np.ones_like(found.support)
            found = replace(
                found, agreement=reliability, support=ones, inside=ones, ray=ones, strength=ones
            )
        points = int(np.count_nonzero(self.base.mask))
        return VariantEstimate(found.position, most_reliable(found, points, self.config.border_px))


def most_reliable(estimate: FocusEstimate, points: int, border_px: int) -> Mask:
    """The (H, W) mask of the `points` most reliable candidates, or of all if there are fewer.

    Equal reliability is decided by confidence, then by the order of pixels.
    """
    allowed = np.flatnonzero(without_border(estimate.candidate, border_px))
    reliability, confidence = (
        image.ravel()[allowed] for image in (estimate.reliability, estimate.confidence)
    )
    kept = allowed[np.lexsort((allowed, -confidence, -reliability))[: max(points, 0)]]
    mask = np.zeros(estimate.candidate.shape, np.bool_)
    mask.flat[kept] = True
    return mask


def judge(
    confidence: Floats,
    vote_peak: Floats,
    position: Floats,
    camera_positions: Sequence[Floats],
    disparity_px: NDArray[np.floating],
    config: FocusConfig,
    allowed: Mask | None = None,
) -> FocusEstimate:
    """`emvs.depth.focus.judge_at` at every pixel; everything is an image.

    `allowed` is where a candidate may be, by default everywhere.
    """
    everywhere = tuple(np.indices(confidence.shape).reshape(2, -1))
    candidate, cameras = candidate_mask(confidence, config), [c.ravel() for c in camera_positions]
    candidate = candidate if allowed is None else candidate & allowed
    return judge_at(
        everywhere, candidate, confidence, vote_peak.ravel(), position, cameras, disparity_px,
        config,
    )  # fmt: skip


def maximum_of(volume: Floats) -> Maximum:
    """The first maximum of a whole (N, H, W) volume along its first axis."""
    planes = len(volume)
    index = volume.argmax(0)

    def at(plane: NDArray[np.int64]) -> Floats:
        inside = np.clip(plane, 0, planes - 1)[None]
        value: Floats = np.take_along_axis(volume, inside, 0)[0]
        return value

    return Maximum(at(index), index.astype(np.int16), at(index - 1), at(index + 1), planes)


def found_in_volumes(
    fused: Floats, votes: Floats, disparity_px: NDArray[np.floating], config: FocusConfig
) -> FocusEstimate:
    """What the mapper's `Focus/...` finds, with any parameters, in volumes that are kept whole.

    Args:
        fused: (N, H, W) float32, the cameras' votes fused by any function.
        votes: (C, N, H, W) float32 votes of each camera.
        disparity_px: (N,) disparity of each plane, px, above 0.
        config: parameters.
    """
    vote_peak = maximum_of(fused)
    own, *cameras = (_sharpest(volume, config) for volume in (fused, *votes))
    judged = judge(
        vote_peak.value, vote_peak.position(), own.position(gaussian=True),
        [one.position(gaussian=True) for one in cameras], disparity_px, config,
        between_the_ends(own),
    )  # fmt: skip
    return on_surface(judged, disparity_px, config)


def _sharpest(volume: Floats, config: FocusConfig) -> Maximum:
    """Where a whole (N, H, W) volume is most in focus."""
    peak = FocusPeak(volume.shape[2], volume.shape[1], config.measure, config.sigma_px)
    peak.update(volume)
    return peak.maximum()


def finalists(volumes: Volumes) -> dict[str, VariantEstimate]:
    """Alg1/H, the three factors that came first, ours, and ours from one camera."""
    ours = volumes.best(volumes.found(_OURS))
    return {BASE: volumes.base, BEFORE: _before(volumes), OURS: ours, ALONE: volumes.alone()}


def _before(volumes: Volumes) -> VariantEstimate:
    """Depth as it stands, in a smaller square of support, with one tolerance for all depths."""
    config = replace(_UNFITTED, support_radius_px=4)
    found = volumes.found(config)
    steady = _steady_agreement(found, volumes)
    return volumes.best(found, steady * found.support * found.inside)


def _steady_agreement(found: FocusEstimate, volumes: Volumes) -> Floats:
    """Agreement whose tolerance is the same at every disparity."""
    planes = np.arange(len(volumes.disparity_px))
    own_px = np.interp(found.position, planes, volumes.disparity_px)
    steady: Floats = (found.agreement ** np.sqrt(own_px / _OURS.agreement_at_px)).astype(np.float32)
    return steady


def threshold_name(reliability: float) -> str:
    """What the estimate of every pixel with at least this reliability is called."""
    return f"reliability at least {reliability:g}"


def thresholds(volumes: Volumes) -> dict[str, VariantEstimate]:
    """Ours as the mapper reports it: every pixel that is reliable enough."""
    found, border_px = volumes.found(_OURS), volumes.config.border_px
    return {
        threshold_name(reliability): VariantEstimate(
            found.position, at_least(found, reliability, border_px)
        )
        for reliability in RELIABILITIES
    }


def estimates(volumes: Volumes) -> dict[str, VariantEstimate]:
    """Every extraction by its name, Alg1/H first."""
    base = volumes.base
    ours = volumes.found(_OURS)
    chosen = volumes.best(ours)
    out = {
        BASE: base,
        "Alg1/H without median": VariantEstimate(volumes.maximum.position(), base.mask),
    }
    out |= _same_pixels(volumes)
    out |= {
        "Alg1/H's depth at our pixels": VariantEstimate(base.position, chosen.mask),
        "votes, ours": volumes.best(volumes.found(FocusConfig(measure="votes"))),
    }
    out |= {name: volumes.best(ours, rank) for name, rank in _ranks(volumes, ours).items()}
    out["ours, 5 px median"] = VariantEstimate(
        masked_median(ours.position, chosen.mask, 5), chosen.mask
    )
    out["ours, no fit"] = volumes.best(volumes.found(_UNFITTED))
    for sigma_px in (1.5, 3.5):
        found = volumes.found(FocusConfig(sigma_px=sigma_px))
        out[f"ours, scale {sigma_px} px"] = volumes.best(found)
    return out | {BEFORE: _before(volumes), OURS: chosen, ALONE: volumes.alone()}


def _same_pixels(volumes: Volumes) -> dict[str, VariantEstimate]:
    """Each focus measure at the pixels of Alg1/H: what the depth alone gains."""
    out = {}
    for name, sigma_px in _SCALES_PX.items():
        measure = focus_measures.MEASURES[name]
        planes = np.stack([measure(plane, sigma_px) for plane in volumes.fused])
        position = maximum_of(planes).position()
        out[f"{name} {sigma_px:g} px at Alg1/H's pixels"] = VariantEstimate(
            position, volumes.base.mask
        )
    return out


def _ranks(volumes: Volumes, ours: FocusEstimate) -> dict[str, Floats]:
    """Reliabilities that pick the pixels, with the depth of the local variance."""
    peak = maximum_of(volumes.focused)
    rival, spread = _rival_ratio(volumes.focused, peak), _z_score(volumes.focused, peak)
    around = cv2.dilate(ours.confidence, np.ones((3, 3), np.uint8))
    crest = ours.confidence / np.maximum(around, np.float32(1e-6))
    squared = ours.support**2
    factors = {
        "agreement": ours.agreement,
        "support²": squared,
        "inside": ours.inside,
        "own ray": ours.ray,
        "strength": ours.strength,
    }
    return {
        "variance, strongest votes": ours.confidence,
        "variance, second-peak ratio": rival,
        "variance, z-score along the ray": spread,
        **{f"variance, {name}": factor for name, factor in factors.items()},
        **{f"ours without {name}": _product(factors, name) for name in factors},
        "ours, support not squared": _product(factors, "support²") * ours.support,
        "ours, one tolerance for all depths": _product(factors, "agreement")
        * _steady_agreement(ours, volumes),
        "ours × second-peak ratio": rival * ours.reliability,
        "ours × z-score": spread * ours.reliability,
        "ours × share of the strongest neighbour": crest * ours.reliability,
    }


def _product(factors: dict[str, Floats], left_out: str) -> Floats:
    kept = [factor for name, factor in factors.items() if name != left_out]
    return np.asarray(np.prod(kept, axis=0), np.float32)


def _rival_ratio(volume: Floats, peak: Maximum) -> Floats:
    """Logarithm of the peak over the largest value more than six planes away from it."""
    apart = np.abs(np.arange(len(volume))[:, None, None] - peak.plane) > RIVAL_GAP_PLANES
    rival = np.where(apart, volume, 0).max(0)
    ratio: Floats = np.log(np.maximum(peak.value / np.maximum(rival, 1e-6), 1)).astype(np.float32)
    return ratio


def _z_score(volume: Floats, peak: Maximum) -> Floats:
    score: Floats = (peak.value - volume.mean(0)) / np.maximum(volume.std(0), 1e-6)
    return score.astype(np.float32)
