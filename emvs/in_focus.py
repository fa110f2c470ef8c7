"""Extraction by focus: depth where rays meet most sharply, kept where cameras and neighbours agree.

Our own alternative to the ray maximum (`docs/extraction.md`). Planes pass one at a time; per pixel
and witness 18 bytes remain, whatever the number of planes.

    finder = FocusFinder(cameras=2, width_px=346, height_px=260)
    for fused, votes in planes:          # (H, W) and (C, H, W), near to far
        finder.take(fused, votes)
    found = finder.found(plane_px=0.3)
    mask = most_reliable(found, points=4000, border_px=2)
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs import focus, focus_kernels
from emvs.depthmap import eight_bits
from emvs.errors import InputError
from emvs.focus_config import FocusConfig
from emvs.found import Found
from emvs.running import Maximum

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]


class _Peak:
    """First maximum over planes of one volume, and its neighbours, as planes pass."""

    def __init__(self, height_px: int, width_px: int) -> None:
        shape = (height_px, width_px)
        self._best = np.full(shape, -np.inf, np.float32)
        self._index = np.full(shape, -2, np.int16)
        self._left, self._right = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        self._previous = np.zeros(shape, np.float32)

    def take(self, value: Floats, plane: int) -> None:
        focus_kernels.fold_peak(
            value, plane, self._best, self._index, self._left, self._right, self._previous
        )

    def maximum(self, planes: int) -> Maximum:
        return Maximum(self._best, self._index, self._left, self._right, planes)


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
        self._measure = focus.measure(self._config.measure)
        self._votes, self._fused = _Peak(*self._shape), _Peak(*self._shape)
        self._cameras = [_Peak(*self._shape) for _ in range(cameras)]
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
        sigma_px = self._config.sigma_px
        self._votes.take(fused, self._planes)
        self._fused.take(self._measure(fused, sigma_px), self._planes)
        for peak, plane in zip(self._cameras, by_camera, strict=True):
            peak.take(self._measure(plane, sigma_px), self._planes)
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
        config, confidence = self._config, self._votes.maximum(self._planes).value
        position = self._fused.maximum(self._planes).position()
        candidate = _candidates(confidence, config)
        support = np.empty_like(position)
        focus_kernels.support(
            position, candidate, config.support_radius_px,
            np.float32(config.support_px / plane_px), support,
        )  # fmt: skip
        agreement = self._agreement(position, plane_px)
        return Found(position, confidence, candidate, agreement, support)

    def _agreement(self, position: Floats, plane_px: float) -> Floats:
        """1 where every camera alone has its focus at the same depth; falls exponentially."""
        apart = np.zeros_like(position)
        if len(self._cameras) > 1:
            for peak in self._cameras:
                np.maximum(apart, abs(peak.maximum(self._planes).position() - position), out=apart)
        agreement: Floats = np.exp(-apart * np.float32(plane_px / self._config.agreement_px))
        return agreement


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
