"""How reliable each pixel's depth is, and its refinement on the surface that it lies on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs.depthmap import eight_bits
from emvs.dsi import focus_kernels, focus_measures
from emvs.focus_config import FocusConfig
from emvs.found import Found

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

_SLOPE_SIGMA_PX = 0.8  # scale of the votes' slope: that of a ridge of votes, not of its noise
_SURFACE_REACH = 1.5  # half the fitted window, in its scale: what is farther hardly counts
_RIDGE_PX2 = 0.5  # keeps slopes that nothing determines at 0


def judge(
    confidence: Floats,
    loudest: Floats,
    position: Floats,
    witnesses: Sequence[Floats],
    disparity_px: NDArray[np.floating],
    config: FocusConfig,
) -> Found:
    """Says how reliable each pixel's depth is.

    Args:
        confidence: (H, W) float32 maximum of the fused volume, votes.
        loudest: (H, W) float32 plane index of that maximum.
        position: (H, W) float32 plane index where the fused volume is most in focus.
        witnesses: the same of each camera's own volume, whose agreement is asked for.
        disparity_px: (N,) disparity of each plane, px, above 0.
        config: scales.
    """
    planes = np.arange(len(disparity_px))

    def disparity(at: Floats) -> Floats:
        return np.asarray(np.interp(at, planes, disparity_px), np.float32)

    own_px = disparity(position)
    candidate = _candidates(confidence, config)
    support = np.zeros_like(position)
    focus_kernels.support(
        own_px, candidate, config.support_radius_px, np.float32(config.support_px), support
    )
    apart_px = np.zeros_like(position)
    for witness in witnesses:
        np.maximum(apart_px, abs(disparity(witness) - own_px), out=apart_px)
    allowed_px = config.agreement_px * np.sqrt(own_px / np.float32(config.agreement_at_px))
    return Found(
        position,
        confidence,
        candidate,
        agreement=np.exp(-apart_px / allowed_px),
        support=support,
        inside=_inside(confidence, own_px, candidate, config),
        ray=np.exp(-abs(disparity(loudest) - own_px) / np.float32(config.ray_px)),
        strength=_strength(confidence, candidate),
    )


def on_surface(found: Found, disparity_px: NDArray[np.floating], config: FocusConfig) -> Found:
    """Moves each candidate to the plane that fits the disparities of its own surface around it.

    A plane in space is linear in disparity over the image, so a slanted surface stays what it is.

    Args:
        found: the extraction.
        disparity_px: (N,) disparity of each plane, px, rising or falling.
        config: scale of the fit, and who takes part.
    """
    planes = np.arange(len(disparity_px), dtype=np.float64)
    own_px = np.interp(found.position, planes, disparity_px).astype(np.float32)
    reach_px = round(_SURFACE_REACH * config.surface_sigma_px)
    weight = focus_measures.half_window(config.surface_sigma_px)[: reach_px + 1]
    fitted_px = own_px.copy()
    focus_kernels.fit_surface(
        own_px, found.candidate, weight, np.float32(config.surface_px), _RIDGE_PX2, fitted_px
    )
    rising = np.argsort(disparity_px)
    moved = np.interp(fitted_px, disparity_px[rising], planes[rising]).astype(np.float32)
    return replace(found, position=np.where(found.candidate, moved, found.position))


def _strength(confidence: Floats, candidate: Mask) -> Floats:
    """Votes as a share of themselves and those of the median candidate."""
    usual = np.float32(np.median(confidence[candidate])) if candidate.any() else np.float32(1)
    return np.asarray(confidence / (confidence + usual), np.float32)


def _candidates(confidence: Floats, config: FocusConfig) -> Mask:
    kept = cv2.adaptiveThreshold(
        eight_bits(confidence, 0.0),
        1,
        cv2.ADAPTIVE_THRESH_GAUSSIAN_C,
        cv2.THRESH_BINARY,
        config.threshold_kernel_px,
        -config.threshold_c,
    )
    return (kept > 0) & (confidence > 0)


def _inside(confidence: Floats, own_px: Floats, candidate: Mask, config: FocusConfig) -> Floats:
    """Near 0 where the votes rise steeply towards the pixel's own surface: it lies beyond an edge.

    The ridge of votes along a silhouette is a few pixels wide, and its outer half shows what is
    behind. Where the own surface lies is seen from the candidates around.
    """
    towards = np.zeros((2, *confidence.shape), np.float32)
    focus_kernels.own_surface(
        own_px, candidate, config.inside_radius_px, np.float32(config.support_px), towards
    )
    smooth = focus_measures.blurred(confidence, _SLOPE_SIGMA_PX)
    slope_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8)
    slope_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
    rise = (towards[0] * slope_x + towards[1] * slope_y) / np.maximum(confidence, np.float32(1e-6))
    steepness = np.clip(rise / np.float32(config.inside_rise), -50, 50)
    return np.asarray(1 / (1 + np.exp(steepness)), np.float32)
