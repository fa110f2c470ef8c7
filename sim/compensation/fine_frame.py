"""A fine frame: the light around every pixel of one camera at one time, and how far it may go."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.sim.compensation.edge_reach_kernels import Seen
from eventsweep.sim.compensation.range_kernels import cell_depths, cell_range, spread_most
from eventsweep.sim.rendering.base import Frame
from eventsweep.sim.rendering.box_kernels import box_mean

Image = NDArray[np.float32]


class Reach(NamedTuple):
    """Bounds of the light that a pixel can see while it moves by up to some pixels.

    Attributes:
        low: (H, W) least light within reach of each pixel.
        high: (H, W) greatest.
        slope: (H + 2 B, W + 2 B) greatest change of light per pixel of way, around each pixel.
    """

    low: Image
    high: Image
    slope: Image


class FineFrame:
    """What one camera sees at one time, between its pixels as well.

    Made of a frame with samples (`sim.rendering.base.Frame`), `grid` of them per pixel and axis;
    until the next frame no pixel moves further than `reach_px`.
    """

    def __init__(self, frame: Frame, grid: int, reach_px: float) -> None:
        assert frame.samples is not None
        self.pixels, self.samples, self.grid = frame.intensity, frame.samples, grid
        self.shape = frame.intensity.shape
        self.border_px = (self.samples.light.shape[1] // grid - self.shape[1]) // 2
        self.rho: Image = np.asarray(1 / frame.nearest_depth_m, np.float32)
        self._reach_px = reach_px

    @cached_property
    def light(self) -> Image:
        """(S (H + 2 B - 1) + 1, S (W + 2 B - 1) + 1) what a pixel would see in every place.

        There are S places per pixel and axis; that of the sensor's first pixel lies B pixels from
        the corner.
        """
        rows, columns = self.samples.light.shape
        light = np.empty((rows - self.grid + 1, columns - self.grid + 1), np.float32)
        box_mean(self.samples.light, self.grid, light)
        return light

    @cached_property
    def reach(self) -> Reach:
        """How bright, how dark and how steep it is around each pixel."""
        low, high, slope = (np.empty(self._wide, np.float32) for _ in range(3))
        cell_range(self.light, self.grid, low, high, slope)
        np.negative(low, out=low)
        # A place lies in the cell of its lower corner, and takes light from two nodes further.
        around = int(np.ceil(self._reach_px)) + 1
        spread_most(low, around + 1, around)
        spread_most(high, around + 1, around)
        spread_most(slope, 1, 1)
        return Reach(-low[self._inner], high[self._inner].copy(), slope)

    def seen(self, body: NDArray[np.uint16]) -> Seen:
        """The same as compiled code takes it, where (H + 2 B, W + 2 B) pixels show these bodies."""
        return Seen(*self.samples, self.light, *self._cells, body)

    @cached_property
    def _cells(self) -> tuple[Image, Image]:
        nearest, farthest = (np.empty(self._wide, np.float32) for _ in range(2))
        cell_depths(self.samples.inverse_depth_per_m, self.grid, nearest, farthest)
        return nearest, farthest

    @property
    def _wide(self) -> tuple[int, int]:
        return self.shape[0] + 2 * self.border_px, self.shape[1] + 2 * self.border_px

    @property
    def _inner(self) -> tuple[slice, slice]:
        (height, width), border = self.shape, self.border_px
        return slice(border, border + height), slice(border, border + width)
