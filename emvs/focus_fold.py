"""What a sweep remembers, beside the votes' maxima, for methods whose depth is found by focus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.focus_peak import FocusPeak
from emvs.fusion import fuse_by
from emvs.recipe import Method
from emvs.running import Maximum

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class InFocus:
    """Where one method's rays are most in focus.

    Attributes:
        maximum: of the focus measure of its fused volume.
        witnesses: the same of each camera's own volume, where their agreement is asked for.
    """

    maximum: Maximum
    witnesses: tuple[Maximum, ...]


def measure_of(method: Method, config: MapperConfig) -> str:
    """What a method's depth maximises along a ray: `votes`, or a focus measure by its name."""
    return config.focus_measure if method.focus else config.extraction


def needs_focus(methods: Sequence[Method], config: MapperConfig) -> list[Method]:
    """Those of the methods that need a focus measure."""
    return [method for method in methods if measure_of(method, config) != "votes"]


class FocusFold:
    """Peaks of the focus measure of every method that needs one, and of each camera's votes.

    Args:
        methods: the methods of one sweep; those without a focus measure are left alone.
        cameras: number of cameras.
        width_px: columns.
        height_px: rows.
        config: measure, scale and number of planes.
    """

    def __init__(
        self, methods: Sequence[Method], cameras: int, width_px: int, height_px: int,
        config: MapperConfig,
    ) -> None:  # fmt: skip
        self._polarities, self._cameras = config.polarities, cameras
        measured = needs_focus(methods, config)
        asked = any(m.focus and m.camera() is None for m in measured)

        def peak(measure: str) -> FocusPeak:
            return FocusPeak(width_px, height_px, measure, config.focus_sigma_px, config.planes)

        self._peaks = {method: peak(measure_of(method, config)) for method in measured}
        self._witnesses = [peak(config.focus_measure) for _ in range(cameras if asked else 0)]

    def take(self, images: Floats) -> None:
        """Takes in the next planes of (V, P, H, W) votes, in order."""
        for method, peak in self._peaks.items():
            for plane in self._fused(method, images):
                peak.take(plane)
        for camera, peak in enumerate(self._witnesses):
            for plane in self._of_camera(images, camera):
                peak.take(plane)

    def found(self) -> dict[str, InFocus]:
        """What was found, by the methods' names."""
        cameras = tuple(peak.maximum() for peak in self._witnesses)
        return {
            method.name: InFocus(
                peak.maximum(), cameras if method.focus and method.camera() is None else ()
            )
            for method, peak in self._peaks.items()
        }

    def _fused(self, method: Method, images: Floats) -> Floats:
        camera = method.camera()
        if camera is not None:
            return self._of_camera(images, camera)
        return fuse_by(method, images, self._polarities)

    def _of_camera(self, images: Floats, camera: int) -> Floats:
        """(P, H, W) votes of one camera: of all polarities and sub-intervals together."""
        parts = images.reshape(self._polarities, self._cameras, -1, *images.shape[1:])[:, camera]
        whole = parts.reshape(-1, *images.shape[1:])
        return np.asarray(whole[0] if len(whole) == 1 else whole.sum(axis=0), np.float32)
