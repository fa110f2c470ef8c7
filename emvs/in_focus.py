"""Extraction by focus: depth where rays meet most sharply, kept where cameras and neighbours agree.

Our own alternative to the ray maximum (`docs/extraction.md`). Planes pass one at a time; per pixel
and witness 18 bytes remain, whatever the number of planes. The mapper asks for it by the name of a
method, `Focus/H`; on its own it is used so:

    finder = FocusFinder(cameras=2, width_px=346, height_px=260)
    for fused, votes in planes:          # (H, W) and (C, H, W), near to far
        finder.take(fused, votes)
    found = finder.found(disparity_px)   # (N,), of each plane: baseline x focal length / depth
    mask = most_reliable(found, points=4000, border_px=2)
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from emvs.focus_config import FocusConfig
from emvs.focus_judge import judge, on_surface
from emvs.focus_peak import FocusPeak
from emvs.found import Found

Floats = NDArray[np.float32]


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

    def found(self, disparity_px: NDArray[np.floating]) -> Found:
        """Returns the depth of all planes so far, and how reliable it is.

        Args:
            disparity_px: (N,) disparity of each plane, px: baseline times focal length times its
                inverse depth.

        Raises:
            InputError: no plane has passed, or there is no disparity above 0 for each.
        """
        if (
            self._planes == 0
            or disparity_px.shape != (self._planes,)
            or not (disparity_px > 0).all()
        ):
            raise InputError(
                f"{self._planes} planes, disparities of shape {disparity_px.shape}: needs at least "
                "1 plane, and for each a disparity > 0"
            )
        votes, fused = self._votes.maximum(), self._fused.maximum()
        witnesses = [peak.maximum().position(bell=True) for peak in self._cameras]
        judged = judge(
            votes.value, votes.position(), fused.position(bell=True), witnesses, disparity_px,
            self._config,
        )  # fmt: skip
        return on_surface(judged, disparity_px, self._config)


def find(
    fused: Floats,
    votes: Floats,
    disparity_px: NDArray[np.floating],
    config: FocusConfig | None = None,
) -> Found:
    """Extracts depth by focus from whole volumes, plane by plane.

    Args:
        fused: (N, H, W) float32, the cameras' votes fused by any function.
        votes: (C, N, H, W) float32 votes of each camera.
        disparity_px: (N,) disparity of each plane, px.
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
    return finder.found(disparity_px)
