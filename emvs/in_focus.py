"""Extraction by focus: depth where rays meet most sharply, kept where cameras and neighbours agree.

Our own alternative to the ray maximum (`docs/extraction.md`). Planes pass one at a time; per pixel
and witness 18 bytes remain, whatever the number of planes. The mapper asks for it by the name of a
method, `Focus/H`; on its own it is used so:

    finder = FocusFinder(cameras=2, width_px=346, height_px=260)
    for fused, votes in planes:          # (H, W) and (C, H, W), near to far
        finder.take(fused, votes)
    found = finder.found(plane_px=0.3)
    mask = most_reliable(found, points=4000, border_px=2)
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs import focus, focus_kernels
from emvs.depthmap import eight_bits
from emvs.errors import InputError
from emvs.focus_config import FocusConfig
from emvs.focus_peak import FocusPeak
from emvs.found import Found

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

_SLOPE_SIGMA_PX = 0.8  # scale of the votes' slope: that of a ridge of votes, not of its noise


class FocusFinder:
    """State of the extraction while planes pass.

    Args:
        cameras: number of cameras whose votes come with the fused plane.
        width_px: columns.
        height_px: rows.
        config: its measure and scale are used here.
    """

    def __init__(
        self, cameras: int, width_px: int, height_px: int, config: FocusConfig | None = None
    ) -> None:
        self._config = FocusConfig() if config is None else config
        self._shape = (height_px, width_px)
        size, measure = (width_px, height_px), (self._config.measure, self._config.sigma_px)
        self._votes, self._fused = FocusPeak(*size, "votes", 1.0), FocusPeak(*size, *measure)
        self._cameras = [FocusPeak(*size, *measure) for _ in range(cameras)]
        self._planes = 0

    def take(self, fused: Floats, votes: Iterable[Floats]) -> None:
        """Takes in the next plane.

        Args:
            fused: (H, W) float32, the cameras' votes fused by any function.
            votes: one (H, W) float32 for each camera.

        Raises:
            InputError: a plane of another shape, or another number of cameras.
        """
        by_camera = list(votes)
        shapes = {plane.shape for plane in (fused, *by_camera)}
        if shapes != {self._shape} or len(by_camera) != len(self._cameras):
            raise InputError(
                f"{len(by_camera)} camera planes of shapes {sorted(shapes)}: "
                f"needs {len(self._cameras)} and a fused one, all {self._shape}"
            )
        self._votes.take(fused)
        self._fused.take(fused)
        for peak, plane in zip(self._cameras, by_camera, strict=True):
            peak.take(plane)
        self._planes += 1

    def found(self, plane_px: float) -> Found:
        """Returns the depth of all planes so far, and how reliable it is.

        Args:
            plane_px: disparity between two planes, px: b f times their step in inverse depth.

        Raises:
            InputError: no plane has passed, or `plane_px` is not positive.
        """
        if self._planes == 0 or not plane_px > 0:
            raise InputError(
                f"{self._planes} planes {plane_px} px apart: needs at least 1, and a distance > 0"
            )
        return judge(
            self._votes.maximum().value,
            self._fused.maximum().position(),
            [peak.maximum().position() for peak in self._cameras],
            -plane_px * np.arange(self._planes),
            self._config,
        )


def judge(
    confidence: Floats,
    position: Floats,
    witnesses: Sequence[Floats],
    disparity_px: NDArray[np.floating],
    config: FocusConfig,
) -> Found:
    """Says how reliable each pixel's depth is.

    Args:
        confidence: (H, W) float32 maximum of the fused volume, votes.
        position: (H, W) float32 plane index where the fused volume is most in focus.
        witnesses: the same of each camera's own volume, whose agreement is asked for.
        disparity_px: (N,) disparity of each plane, px; what counts are differences.
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
    agreement: Floats = np.exp(-apart_px / np.float32(config.agreement_px))
    inside = _inside(confidence, own_px, candidate, config)
    return Found(position, confidence, candidate, agreement, support, inside)


def find(fused: Floats, votes: Floats, plane_px: float, config: FocusConfig | None = None) -> Found:
    """Extracts depth by focus from whole volumes, plane by plane.

    Args:
        fused: (N, H, W) float32, the cameras' votes fused by any function.
        votes: (C, N, H, W) float32 votes of each camera.
        plane_px: disparity between two planes, px.
        config: parameters.

    Raises:
        InputError: volumes whose shapes do not agree.
    """
    if fused.ndim != 3 or votes.shape[1:] != fused.shape:
        raise InputError(
            f"volumes of shapes {fused.shape} and {votes.shape}: needs (N, H, W) and (C, N, H, W)"
        )
    finder = FocusFinder(len(votes), fused.shape[2], fused.shape[1], config)
    for plane, value in enumerate(fused):
        finder.take(value, votes[:, plane])
    return finder.found(plane_px)


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
    smooth = focus.blurred(confidence, _SLOPE_SIGMA_PX)
    slope_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8)
    slope_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
    rise = (towards[0] * slope_x + towards[1] * slope_y) / np.maximum(confidence, np.float32(1e-6))
    steepness = np.clip(rise / np.float32(config.inside_rise), -50, 50)
    return np.asarray(1 / (1 + np.exp(steepness)), np.float32)
