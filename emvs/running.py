"""Every method's running maximum over planes, so that no volume is ever stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs import fuse_kernels
from emvs.fusion import Method

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Maximum:
    """The first maximum over planes of one fused volume, per pixel.

    Attributes:
        value: (H, W) float32 the maximum.
        plane: (H, W) int16 its plane.
        left: (H, W) float32 the value one plane before it, where there is one.
        right: (H, W) float32 the value one plane after it, where there is one.
        planes: number of planes.
    """

    value: Floats
    plane: NDArray[np.int16]
    left: Floats
    right: Floats
    planes: int

    def position(self) -> Floats:
        """The maximum's place between planes: vertex of the parabola through three values.

        Returns:
            (H, W) float32 plane index, within half a plane of `plane`; whole at the first and the
            last plane, which have one neighbour only.
        """
        inner = (self.plane > 0) & (self.plane < self.planes - 1)
        # Two roundings of one number: 0 only where left = value = right
        bend = (self.value - self.left) + (self.value - self.right)
        inner &= bend > 0
        offset = np.zeros_like(self.value)
        np.divide(0.5 * (self.right - self.left), bend, out=offset, where=inner)
        return self.plane.astype(np.float32) + offset


class RunningMaxima:
    """State of the fold: what each method needs to remember of the planes that have passed."""

    def __init__(self, methods: Sequence[Method], width_px: int, height_px: int) -> None:
        shape = (len(methods), height_px, width_px)
        self._codes = np.array([method.code for method in methods], np.int64)
        self._planes = 0
        self._fused = np.empty(shape[1:], np.float32)
        self._best = np.full(shape, -1, np.float32)
        self._index = np.full(shape, -2, np.int16)
        self._left, self._right = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        self._previous = np.zeros(shape, np.float32)

    def fold(self, votes: Floats, planes: int) -> None:
        """Takes in the next `planes` planes of (C, P, cells) votes, in order."""
        fuse_kernels.fold(
            self._codes, votes, self._planes, planes, self._fused, self._best, self._index,
            self._left, self._right, self._previous,
        )  # fmt: skip
        self._planes += planes

    def of(self, method: int) -> Maximum:
        """The maximum of one method, by its position in the list, over all planes so far."""
        return Maximum(
            self._best[method], self._index[method], self._left[method], self._right[method],
            self._planes,
        )  # fmt: skip
