"""Every method's running maximum over planes, so that no volume is ever stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emvs import fuse_kernels
from emvs.fusion import fuse_by
from emvs.recipe import Method, Tables

Floats = NDArray[np.float32]

_INT16 = 32767  # so many planes can be counted by 16 bits
# Cells that the fold takes in one go: starting a row costs 0.3 µs, as much as 500 cells; longer
# rows than these gain nothing and leave less to share among threads.
_ROW_CELLS = 4096
_AS_IT_IS = Method("", fuse_kernels.CAMERA, "the one volume there is")


@dataclass(frozen=True, eq=False)
class Maximum:
    """The first maximum over planes of one fused volume, per pixel.

    Attributes:
        value: (H, W) float32 the maximum.
        plane: (H, W) int16 its plane, int32 where there are more than 32767.
        left: (H, W) float32 the value one plane before it, where there is one.
        right: (H, W) float32 the value one plane after it, where there is one.
        planes: number of planes.
    """

    value: Floats
    plane: NDArray[Any]
    left: Floats
    right: Floats
    planes: int

    def position(self, *, bell: bool = False) -> Floats:
        """The maximum's place between planes: vertex of the parabola through three values.

        Args:
            bell: of the Gaussian through them instead, where all three are positive.

        Returns:
            (H, W) float32 plane index, within half a plane of `plane`; whole at the first and the
            last plane, which have one neighbour only.
        """
        inner = (self.plane > 0) & (self.plane < self.planes - 1)
        left, value, right = self._logarithms() if bell else (self.left, self.value, self.right)
        # Two roundings of one number: 0 only where left = value = right
        bend = (value - left) + (value - right)
        inner &= bend > 0
        offset = np.zeros_like(self.value)
        np.divide(0.5 * (right - left), bend, out=offset, where=inner)
        return self.plane.astype(np.float32) + offset

    def _logarithms(self) -> tuple[Floats, Floats, Floats]:
        """The three values' logarithms, whose parabola is the Gaussian's; as they are elsewhere."""
        values = (self.left, self.value, self.right)
        positive = (self.left > 0) & (self.right > 0)
        left, value, right = (np.log(v, out=v.copy(), where=positive) for v in values)
        return left, value, right


class RunningMaxima:
    """State of the fold: what each method needs to remember of the planes that have passed.

    The methods must share one split; `planes` is needed only where there are more than 32767.
    """

    def __init__(
        self,
        methods: Sequence[Method],
        width_px: int,
        height_px: int,
        *,
        planes: int = 0,
        polarities: int = 1,
    ) -> None:
        shape = (len(methods), height_px, width_px)
        self._compiled = [m for m in methods if m.function is None]
        self._own = [m for m in methods if m.function is not None]
        self._row = [[*self._compiled, *self._own].index(method) for method in methods]
        self._polarities = polarities
        self._planes = 0
        self._best = np.full(shape, -1, np.float32)
        self._index = np.full(shape, -2, np.int16 if planes <= _INT16 else np.int32)
        self._left, self._right = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        self._previous = np.zeros(shape, np.float32)

    def fold(self, votes: Floats, planes: int) -> None:
        """Takes in the next `planes` planes of (V, P, cells) votes, in order."""
        split = len(self._compiled)
        if self._compiled:
            tables = Tables.of(self._compiled, len(votes), self._polarities)
            self._fold(tables, votes, planes, slice(0, split))
        if self._own:
            height, width = self._best.shape[1:]
            images = votes[:, :planes, : height * width].reshape(-1, planes, height, width)
        for k, method in enumerate(self._own, split):
            fused = fuse_by(method, images, self._polarities).reshape(1, planes, -1)
            self._fold(Tables.of((_AS_IT_IS,), 1), fused, planes, slice(k, k + 1))
        self._planes += planes

    def _fold(self, tables: Tables, votes: Floats, planes: int, rows: slice) -> None:
        state = self._best, self._index, self._left, self._right, self._previous
        long = [_in_long_rows(one[rows]) for one in state]
        fuse_kernels.fold(  # type: ignore[call-arg]
            *tables.arrays, votes, self._planes, planes, *tables.scratch(*long[0].shape[1:]), *long
        )

    def of(self, method: int) -> Maximum:
        """The maximum of one method, by its position in the list, over all planes so far."""
        row = self._row[method]
        return Maximum(
            self._best[row], self._index[row], self._left[row], self._right[row], self._planes
        )


def _in_long_rows(images: NDArray[Any]) -> NDArray[Any]:
    """(M, H, W) images as (M, H / k, k W), the same memory: every pixel is folded by itself."""
    count, height, width = images.shape
    fits = (k for k in range(1, height + 1) if height % k == 0 and k * width <= _ROW_CELLS)
    k = max(fits, default=1)
    return images.reshape(count, height // k, k * width)
