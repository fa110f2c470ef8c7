"""From what was drawn to the samples of fine frames: what there is to do, and by a CPU.

`sim.rendering.light_shader` is the other way, a GPU's.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.rendering import pixel_kernels
from eventsweep.sim.rendering.base import Samples
from eventsweep.sim.rendering.draw_target import DrawTarget
from eventsweep.sim.rendering.lens import border_of
from eventsweep.sim.rendering.sub_views import LensMap, SubView

Image = NDArray[np.float32]


class Picture(NamedTuple):
    """What is drawn before light is worked out: every k-th row of a view's samples.

    Attributes:
        parts: the pinhole pictures that are drawn.
        samples: per pixel of these, along a row and along a column.
        first_row: the first of the view's rows that is in it.
    """

    parts: tuple[SubView, ...]
    samples: tuple[int, int]
    first_row: int


@dataclass(frozen=True, eq=False)
class FineView:
    """One camera's share in fine frames: what is drawn for it and what becomes of that.

    What is drawn is the sensor with a border of equal width on all sides; its lens, None for a
    pinhole, says where its pixels lie in the pictures.
    """

    sensor: Camera
    drawn: Camera
    lens: LensMap | None
    supersample: int

    @property
    def stride(self) -> int:
        """How many pictures make the samples of the view: rows of each lie beside the others'.

        A vertical edge passes a sample in all rows of a regular grid at the same time. In k
        pictures, each k-th of a sample to the side, it passes one after the other, k S in a pixel.
        """
        return 1 if self.lens or self.supersample % 2 else 2

    def pictures(self) -> Iterator[Picture]:
        """All that is drawn for it."""
        if self.lens:
            yield Picture(self.lens.views, (1, 1), 0)
            return
        n, k = self.supersample, self.stride
        for row in range(k):
            # From the middle of this picture's samples to where they shall lie, px.
            right, down = ((row + 0.5) / k - 0.5) / n, (row + 0.5 - 0.5 * k) / n
            cx_px, cy_px = self.drawn.cx_px - right, self.drawn.cy_px - down
            camera = replace(self.drawn, cx_px=cx_px, cy_px=cy_px)
            yield Picture((SubView(camera),), (n, n // k), row)

    @property
    def picture_shape(self) -> tuple[int, int]:
        """Rows and columns of each picture."""
        if self.lens:
            return self.lens.shape
        n = self.supersample
        return n // self.stride * self.drawn.height_px, n * self.drawn.width_px

    @property
    def samples_shape(self) -> tuple[int, int]:
        """Rows and columns of the samples of `drawn`."""
        return self.supersample * self.drawn.height_px, self.supersample * self.drawn.width_px

    @property
    def border_px(self) -> int:
        """How far `drawn` reaches beyond the sensor."""
        return border_of(self.sensor, self.drawn)

    @property
    def inner(self) -> tuple[slice, slice]:
        """The sensor's rows and columns in `drawn`."""
        first, sensor = self.border_px, self.sensor
        return slice(first, first + sensor.height_px), slice(first, first + sensor.width_px)


class FineLight(Protocol):
    """Turns what was drawn last into samples."""

    @property
    def by(self) -> str:
        """How, for a sequence's manifest; empty where that is as ever."""

    def take(self, view: FineView, picture: Picture, samples: Samples) -> None:
        """Fills the samples that are in a picture: light, and window depth, 1 near and 0 far."""

    def free(self) -> None:
        """Frees its part of the graphics context, which must be current."""


class KernelLight:
    """Reads colours and depth back, and works the light out on the CPU.

    `by` says why not otherwise; it is empty where there is nothing to tell.
    """

    def __init__(self, target: DrawTarget, by: str = "") -> None:
        self.by = by
        self._target = target
        self._memory = np.empty(0, np.float32)

    def take(self, view: FineView, picture: Picture, samples: Samples) -> None:
        """See `FineLight`."""
        full_scale, k = self._target.full_scale, view.stride
        rgb, window_depth = self._target.read(*view.picture_shape)
        if view.lens is not None:
            luma = self._scratch(view.picture_shape)
            pixel_kernels.luma(rgb, full_scale, luma)
            lens, n = view.lens, view.supersample
            pixel_kernels.resampled(luma, window_depth, lens.position, lens.step, n, *samples)
            return
        light, depth = (part[picture.first_row :: k] for part in samples)
        pixel_kernels.luma(rgb, full_scale, light, True)
        depth[:] = window_depth[::-1]

    def _scratch(self, shape: tuple[int, int]) -> Image:
        """Memory for the time of a frame: to get it anew costs as much as to fill it."""
        size = shape[0] * shape[1]
        if self._memory.size < size:
            self._memory = np.empty(size, np.float32)
        return self._memory[:size].reshape(shape)

    def free(self) -> None:
        """Nothing to free."""
