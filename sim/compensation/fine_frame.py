"""A fine frame: the light around every pixel of one camera at one time, and how far it may go."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.sim.compensation.range_kernels import cell_range, spread_most

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

    The light has `grid` nodes per pixel and axis (`sim.rendering.base.Frame`), the least z-depth of
    each pixel is inf where there is no surface, and until the next frame no pixel moves further
    than `reach_px`.
    """

    def __init__(self, light: Image, nearest_depth_m: Image, grid: int, reach_px: float) -> None:
        height, width = nearest_depth_m.shape
        self.light, self.grid, self.shape = light, grid, (height, width)
        self.border_px = ((light.shape[1] - 1) // grid + 1 - width) // 2
        self.rho = 1 / nearest_depth_m
        self._reach_px = reach_px

    @cached_property
    def pixels(self) -> Image:
        """(H, W) light of the pixels themselves."""
        return self.light[:: self.grid, :: self.grid][self._inner].copy()

    @cached_property
    def reach(self) -> Reach:
        """How bright, how dark and how steep it is around each pixel."""
        height, width = self.shape
        wide = height + 2 * self.border_px, width + 2 * self.border_px
        low, high, slope = (np.empty(wide, np.float32) for _ in range(3))
        cell_range(self.light, self.grid, low, high, slope)
        np.negative(low, out=low)
        # A place lies in the cell of its lower corner, and takes light from two nodes further.
        around = int(np.ceil(self._reach_px)) + 1
        spread_most(low, around + 1, around)
        spread_most(high, around + 1, around)
        spread_most(slope, 1, 1)
        return Reach(-low[self._inner], high[self._inner].copy(), slope)

    @property
    def _inner(self) -> tuple[slice, slice]:
        (height, width), border = self.shape, self.border_px
        return slice(border, border + height), slice(border, border + width)
