"""Every method's running maximum over planes, on the GPU."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from emvs.cuda import arrays, fuse_kernels, library
from emvs.recipe import Method, Tables
from emvs.running import Maximum, beginnings

STATE_BYTES = 4 * 4 + 4  # per pixel and method, at most


class State:
    """What `emvs.running.RunningMaxima` remembers, in the memory of the GPU.

    Attributes:
        arrays: best, index, left, right, previous, each (M, cells) on the GPU.
    """

    def __init__(self, images: int, cells: int, planes: int, lowest: float) -> None:
        self.arrays: tuple[Any, ...] = tuple(
            arrays.filled((images, cells), dtype, value)
            for dtype, value in beginnings(planes, lowest)
        )

    def maximum(self, image: int, width_px: int, planes: int) -> Maximum:
        """One image's maximum over the `planes` planes that have passed, copied from the GPU."""
        best, index, left, right = (
            arrays.down(one[image]).reshape(-1, width_px) for one in self.arrays[:4]
        )
        return Maximum(best, index, left, right, planes)


class DeviceMaxima:
    """State of the fold on the GPU; the methods share one split and have no function of their own.

    Args:
        methods: the methods.
        volumes: how many volumes there are.
        width_px: columns.
        height_px: rows.
        planes: how many planes will pass.
        polarities: 2 where each polarity has volumes of its own.
    """

    def __init__(
        self, methods: Sequence[Method], volumes: int, width_px: int, height_px: int,
        planes: int, polarities: int = 1,
    ) -> None:  # fmt: skip
        self._methods, self._width_px, self._planes = tuple(methods), width_px, 0
        self._cells = width_px * height_px
        self._state = State(len(methods), self._cells, planes, -1)
        self._tables: tuple[Any, ...] = ()
        if methods:
            tables = Tables.of(methods, volumes, polarities)
            self._tables = tuple(map(arrays.up, (tables.codes, tables.sizes, tables.which)))

    def fold(self, votes: Any, planes: int) -> None:
        """Takes in the next `planes` planes of (V, P, cells) votes on the GPU, in order."""
        if self._methods:
            fuse_kernels.fold[library.strided(self._cells, len(self._methods))](
                *self._tables, votes, self._planes, planes, *self._state.arrays
            )
        self._planes += planes

    def found(self) -> dict[str, Maximum]:
        """The maximum of every method over all planes so far, by name."""
        return {
            method.name: self._state.maximum(m, self._width_px, self._planes)
            for m, method in enumerate(self._methods)
        }
