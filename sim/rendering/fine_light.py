"""From the samples that were drawn to the light of fine frames: what there is to do, and by a CPU.

`sim.rendering.light_shader` is the other way, a GPU's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.rendering import box_kernels, pixel_kernels
from eventsweep.sim.rendering.draw_target import DrawTarget
from eventsweep.sim.rendering.lens import LensMap

Image = NDArray[np.float32]


def light_shape(drawn: Camera, supersample: int) -> tuple[int, int]:
    """Rows and columns of the light of what is drawn: of boxes of S x S samples."""
    n = supersample
    return n * (drawn.height_px - 1) + 1, n * (drawn.width_px - 1) + 1


@dataclass(frozen=True, eq=False)
class FineView:
    """One camera's share in fine frames: what is drawn for it and what becomes of that.

    What is drawn is the sensor with a border of equal width on all sides; its lens, None for a
    pinhole, says where its pixels lie in the picture.
    """

    sensor: Camera
    drawn: Camera
    lens: LensMap | None
    supersample: int

    @property
    def source(self) -> tuple[Camera, int]:
        """The pinhole camera that is drawn, and its samples per pixel and axis."""
        return (self.lens.source, 1) if self.lens else (self.drawn, self.supersample)

    @property
    def source_shape(self) -> tuple[int, int]:
        """Rows and columns of what is drawn."""
        camera, samples = self.source
        return samples * camera.height_px, samples * camera.width_px

    @property
    def samples_shape(self) -> tuple[int, int]:
        """Rows and columns of the samples of `drawn`."""
        return self.supersample * self.drawn.height_px, self.supersample * self.drawn.width_px

    @property
    def light_shape(self) -> tuple[int, int]:
        """Rows and columns of boxes of S x S samples."""
        return light_shape(self.drawn, self.supersample)

    @property
    def border_px(self) -> int:
        """How far `drawn` reaches beyond the sensor."""
        return (self.drawn.width_px - self.sensor.width_px) // 2

    @property
    def inner(self) -> tuple[slice, slice]:
        """The sensor's rows and columns in `drawn`."""
        first, sensor = self.border_px, self.sensor
        return slice(first, first + sensor.height_px), slice(first, first + sensor.width_px)


class FineLight(Protocol):
    """Turns what was drawn last into light."""

    @property
    def by(self) -> str:
        """How, for a sequence's manifest; empty where that is as ever."""

    def light(self, view: FineView) -> tuple[Image, Image]:
        """The light on the grid, and the nearest window depth (H, W) in the sensor's pixels."""

    def free(self) -> None:
        """Frees its part of the graphics context, which must be current."""


class KernelLight:
    """Reads colours and depth back, and works the light out on the CPU.

    `by` says why not otherwise; it is empty where there is nothing to tell.
    """

    def __init__(self, target: DrawTarget, by: str = "") -> None:
        self.by = by
        self._target = target
        self._memory = [np.empty(0, np.float32)] * 2

    def light(self, view: FineView) -> tuple[Image, Image]:
        """See `FineLight`."""
        n, full_scale = view.supersample, self._target.full_scale
        rgb, window_depth = self._target.read(*view.source_shape)
        nearest = np.empty((view.drawn.height_px, view.drawn.width_px), np.float32)
        samples = self._scratch(0, view.samples_shape)
        if view.lens is None:
            pixel_kernels.luma(rgb, full_scale, samples, True)
            box_kernels.box_nearest(window_depth, n, nearest)
        else:
            luma = self._scratch(1, view.source_shape)
            pixel_kernels.luma(rgb, full_scale, luma)
            pixel_kernels.resampled(
                luma, window_depth, view.lens.position, view.lens.step, n, samples, nearest
            )
        light = np.empty(view.light_shape, np.float32)
        box_kernels.box_mean(samples, n, light)
        return light, nearest[view.inner]

    def _scratch(self, which: int, shape: tuple[int, int]) -> Image:
        """Memory for the time of a frame: to get it anew costs as much as to fill it."""
        size = shape[0] * shape[1]
        if self._memory[which].size < size:
            self._memory[which] = np.empty(size, np.float32)
        return self._memory[which][:size].reshape(shape)

    def free(self) -> None:
        """Nothing to free."""
