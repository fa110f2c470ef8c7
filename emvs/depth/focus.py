"""Depth where the fused rays are most in focus, how reliable it is, and which pixels to keep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import FocusParameters, MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.depth import neighbours_kernels
from eventsweep.emvs.depth.depth_map import above_mean, eight_bits, without_border
from eventsweep.emvs.dsi import focus_measures
from eventsweep.emvs.dsi.maxima import InFocus, Maximum
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.runtime import in_threads
from eventsweep.emvs.windows import Window

Float32s = NDArray[np.float32]
Mask = NDArray[np.bool_]
Pixels = tuple[NDArray[np.int64], ...]  # rows and columns
# Chosen on simulated data by `python tests/benchmarks study_extraction` of commit 77cd9c78. Lengths
# are pixels of the view, disparities those of the rig's baseline: both keep their meaning for other
# sensors, baselines and depth planes.
AGREEMENT_PX = 0.4
"""Disagreement between cameras that divides the reliability by e, px of disparity, where that is
`_AGREEMENT_AT_PX`; elsewhere it grows with its square root."""
_AGREEMENT_AT_PX = 10.0
_RAY_PX = 3.0  # distance from the plain maximum that divides the reliability by e, of disparity
_SUPPORT_RADIUS_PX = 5  # half the square of neighbours that count
_SUPPORT_PX = np.float32(1)  # how far a neighbour's disparity may be off to count as support
_INSIDE_RADIUS_PX = 8  # half the square in which a pixel looks for its own surface
# Relative rise of the votes, from the pixel to the middle of its own surface, at which it rather
# lies beyond that surface's edge
_INSIDE_RISE = np.float32(0.16)
_SURFACE_SIGMA_PX = 4.0  # scale of the window in which a plane is fitted to the disparities
_SURFACE_PX = np.float32(0.5)  # how far a neighbour's disparity may be off to take part in that
_SURFACE_REACH_PX = 6  # half that window: what is farther hardly counts
_SLOPE_SIGMA_PX = 0.8  # scale of the votes' slope: that of a ridge of votes, not of its noise
_RIDGE_PX2 = 0.5  # keeps slopes that nothing determines at 0
_PATH_SAMPLES = 65


@dataclass(frozen=True, eq=False)
class FocusEstimate:
    """Depth by focus, and what speaks for it, pixel by pixel.

    What the mapper makes is judged at candidates only: elsewhere the factors are 0.

    Attributes:
        position: (H, W) float32 plane index, fractional.
        confidence: (H, W) float32 maximum of the fused volume, votes.
        candidate: (H, W) bool, where that stands out from its surroundings.
        agreement: (H, W) float32 in 0..1, of the cameras with each other; 1 with a single camera.
        support: (H, W) float32 in 0..1, share of the candidates around that have this depth too.
        inside: (H, W) float32 in 0..1, near 0 where the pixel lies beyond its surface's edge.
        ray: (H, W) float32 in 0..1, near 0 where the votes' plain maximum lies elsewhere.
        strength: (H, W) float32 in 0..1, 0.5 where there are as many votes as at half of the
            candidates.
        scatter_px: (H, W) float32, of depths around the fitted surface (`surface_scatter_px`); None
            where none was fitted.
    """

    position: Float32s
    confidence: Float32s
    candidate: Mask
    agreement: Float32s
    support: Float32s
    inside: Float32s
    ray: Float32s
    strength: Float32s
    scatter_px: Float32s | None = None

    @property
    def reliability(self) -> Float32s:
        """(H, W) float32 in 0..1: the product, support squared; 0 where there is no candidate."""
        product = self.agreement * self.support**2 * self.inside * self.ray * self.strength
        return np.where(self.candidate, product, np.float32(0))


def estimate_in_focus(
    votes: Maximum, focus: InFocus, disparity_px: NDArray[np.floating], config: MapperConfig
) -> FocusEstimate:
    """Depth and reliability; between planes only where the configuration refines at all.

    `disparity_px` is (N,), that of each plane, above 0.
    """
    refines, own = config.refines, focus.maximum
    disparity_px = disparity_px.astype(np.float64)
    candidate = candidate_mask(votes.value, config.focus) & between_the_ends(own)
    at = np.nonzero(candidate)
    position = own.position(gaussian=True) if refines else own.plane.astype(np.float32)
    cameras = [m.position_at(*at, refined=refines, gaussian=True) for m in focus.camera_maxima]
    vote_peak = votes.position_at(*at, refined=refines)
    estimate = judge_at(at, candidate, votes.value, vote_peak, position, cameras, disparity_px)
    return on_surface(estimate, disparity_px) if refines else estimate


def judge_at(
    at: Pixels, candidate: Mask, confidence: Float32s, vote_peak: Float32s, position: Float32s,
    camera_positions: Sequence[Float32s], disparity_px: NDArray[np.floating],
) -> FocusEstimate:  # fmt: skip
    """Says how reliable the depth is at (M,) pixels, all candidates among them.

    `vote_peak` and each camera's positions are (M,) plane indices, everything else is an image.
    """
    own_px = disparity_at(position[at], disparity_px)
    disagreement_px = np.zeros_like(own_px)
    for other in camera_positions:
        difference_px = abs(disparity_at(other, disparity_px) - own_px)
        np.maximum(disagreement_px, difference_px, out=disagreement_px)
    allowed_px = AGREEMENT_PX * np.sqrt(own_px / np.float32(_AGREEMENT_AT_PX))
    ray_px = abs(disparity_at(vote_peak, disparity_px) - own_px)
    surroundings_px = np.zeros_like(confidence)
    surroundings_px[at] = own_px
    support = np.zeros_like(confidence)
    listed = neighbours_kernels.listed(surroundings_px, candidate)
    in_threads(
        neighbours_kernels.support, len(support), *listed, _SUPPORT_RADIUS_PX, _SUPPORT_PX, support
    )
    # Votes as a share of themselves and those of the median candidate
    usual = np.float32(np.median(confidence[candidate])) if candidate.any() else np.float32(1)
    factors = (
        np.exp(-disagreement_px / allowed_px),
        support[at],
        _inside(at, confidence, listed),
        np.exp(-ray_px / np.float32(_RAY_PX)),
        confidence[at] / (confidence[at] + usual),
    )
    images = np.zeros((len(factors), *confidence.shape), np.float32)
    for image, factor in zip(images, factors, strict=True):
        image[at] = factor
    return FocusEstimate(position, confidence, candidate, *images)


def disparity_at(position: Float32s, disparity_px: NDArray[np.floating]) -> Float32s:
    """Disparity at fractional planes, float32 px: linear, and beyond the ends that of the end."""
    last = len(disparity_px) - 1
    place = np.clip(position, 0, last)
    before = np.minimum(place.astype(np.int32), max(last - 1, 0))
    table = np.asarray(disparity_px, np.float32)
    step = np.diff(table, append=table[-1:])
    return np.asarray(table[before] + (place - before) * step[before], np.float32)


def candidate_mask(confidence: Float32s, config: FocusParameters) -> Mask:
    """Where (H, W) votes stand out from their surroundings."""
    grey = eight_bits(confidence, 0.0)
    return (confidence > 0) & above_mean(grey, config.threshold_kernel_px, config.threshold_c)


def between_the_ends(maximum: Maximum) -> Mask:
    """(H, W) where the maximum is a peak: at the first and last plane values may rise beyond.

    At the image's rim they do: the farther a plane, the more of its rays the cameras see there.
    """
    return (maximum.plane > 0) & (maximum.plane < maximum.planes - 1)


def _inside(at: Pixels, confidence: Float32s, listed: tuple[NDArray[np.generic], ...]) -> Float32s:
    """Near 0 where the votes rise steeply towards the pixel's own surface: it lies beyond an edge.

    The ridge of votes along a silhouette is a few pixels wide, and its outer half shows what is
    behind. Where the own surface lies is seen from the candidates around, which are `listed`.
    """
    towards = np.zeros((2, *confidence.shape), np.float32)
    in_threads(
        neighbours_kernels.own_surface, len(confidence), *listed, _INSIDE_RADIUS_PX, _SUPPORT_PX,
        towards,
    )  # fmt: skip
    smooth = focus_measures.blurred(confidence, _SLOPE_SIGMA_PX)
    slope_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8)[at]
    slope_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)[at]
    uphill = towards[0][at] * slope_x + towards[1][at] * slope_y
    rise = uphill / np.maximum(confidence[at], np.float32(1e-6))
    steepness = np.clip(rise / _INSIDE_RISE, -50, 50)
    return np.asarray(1 / (1 + np.exp(steepness)), np.float32)


def on_surface(estimate: FocusEstimate, disparity_px: NDArray[np.floating]) -> FocusEstimate:
    """Moves each candidate to the plane that fits the disparities of its own surface around it.

    A plane in space is linear in disparity over the image, so a slanted surface stays what it is.
    `disparity_px` is (N,), rising or falling with the planes.
    """
    at = np.nonzero(estimate.candidate)
    own_px = np.zeros_like(estimate.position)
    own_px[at] = disparity_at(estimate.position[at], disparity_px)
    fitted_px = surface_disparity(own_px, estimate.candidate)
    rising = np.argsort(disparity_px)
    planes = np.arange(len(disparity_px), dtype=np.float64)
    position = estimate.position.copy()
    position[at] = np.interp(fitted_px[at], disparity_px[rising], planes[rising])
    scatter_px = surface_scatter_px(own_px, fitted_px, estimate.candidate)
    return replace(estimate, position=position, scatter_px=scatter_px)


def surface_disparity(own_px: Float32s, candidate: Mask) -> Float32s:
    """(H, W) float32 px: each candidate's disparity on the plane through those around it.

    `own_px` is (H, W) float32, the disparities before; 0 where there is no candidate.
    """
    weight = focus_measures.half_window(_SURFACE_SIGMA_PX)[: _SURFACE_REACH_PX + 1]
    fitted_px = np.zeros_like(own_px)
    in_threads(
        neighbours_kernels.fit_surface, len(own_px), *neighbours_kernels.listed(own_px, candidate),
        weight, _SURFACE_PX, _RIDGE_PX2, fitted_px,
    )  # fmt: skip
    return fitted_px


def surface_scatter_px(own_px: Float32s, fitted_px: Float32s, candidate: Mask) -> Float32s:
    """(H, W) float32: how far candidates around lie from the surface through them; else 0.

    The mean distance of disparities before and after the fit, weighted as in it: the surface is as
    uncertain as what it was fitted to.
    """
    size = (2 * _SURFACE_REACH_PX + 1,) * 2

    def around(image: Float32s) -> Float32s:
        return np.asarray(cv2.GaussianBlur(image, size, _SURFACE_SIGMA_PX), np.float32)

    apart_px = np.where(candidate, np.abs(fitted_px - own_px), np.float32(0))
    share = np.where(candidate, around(candidate.astype(np.float32)), np.float32(1))
    return np.where(candidate, around(apart_px) / share, np.float32(0))


def at_least(estimate: FocusEstimate, reliability: float, border_px: int) -> Mask:
    """The (H, W) mask of candidates with at least this reliability."""
    return without_border(estimate.candidate & (estimate.reliability >= reliability), border_px)


def parallax_baseline_m(recording: Recording, window: Window) -> float:
    """The distance that disparities refer to, m: between cameras 0 and 1, or along the path.

    One camera has no baseline but its own path: the farthest that it gets, in the window, from
    where it is at the reference time.

    Raises:
        InputError: one camera that stays where it is.
    """
    if len(recording.rig) > 1:
        return recording.rig.baseline_m(0, 1)
    first_us, last_us = recording.trajectory.span_us
    t_us = np.linspace(max(window.t0_us, first_us), min(window.t1_us, last_us), _PATH_SAMPLES)
    T_world_cam = recording.trajectory.at(t_us.astype(np.int64)) @ recording.rig.T_body_cam[0]
    T_world_rv = recording.trajectory.at(window.t_ref_us) @ recording.rig.T_body_cam[0]
    offsets_m = T_world_cam[:, :3, 3] - T_world_rv[:3, 3]
    farthest_m = float(np.linalg.norm(offsets_m, axis=1).max())
    if farthest_m == 0:
        raise InputError(
            "Focus methods: one camera that does not move sees no parallax; choose a window in "
            "which it moves, or EMVS/cam0"
        )
    return farthest_m
