"""Arrays on the GPU, rays and events among them: made there, or copied there and back.

The GPU copies by itself, beside its computing, only from memory that cannot be paged out. All cores
fill one such buffer while the other is on its way. Everything is queued in the calling thread's
stream (`plugins.cuda.device.stream`).
"""

# mypy: disable-error-code="attr-defined, misc, no-any-return, no-untyped-call, no-untyped-def"

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import cuda
from numpy.typing import DTypeLike, NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.dsi.rays import RayCounts, Rays
from eventsweep.emvs.errors import InputError
from eventsweep.plugins.cuda import arrays_kernels, device

_BUFFER_BYTES = 16 << 20
_of_thread = threading.local()


def empty(shape: tuple[int, ...], dtype: DTypeLike) -> Any:
    """An array on the GPU that holds anything.

    Raises:
        InputError: too little memory there.
    """
    try:
        return cuda.device_array(shape, dtype)
    except device.CUDA_ERRORS as error:
        size = np.prod(shape, dtype=float) * np.dtype(dtype).itemsize / 1e9
        raise InputError(
            f"the GPU has no {size:.3g} GB left ({' '.join(str(error).split())}): choose a "
            "shorter window, fewer methods or sub-intervals, or device cpu"
        ) from error


def fill(there: Any, value: float) -> Any:
    """Fills a (P, N) array on the GPU with one value; returns it."""
    rows, items = there.shape
    arrays_kernels.fill[device.strided(items, rows)](there, np.array(value, there.dtype)[()])
    return there


def up(array: NDArray[Any]) -> Any:
    """A copy of an array on the GPU, whole when this returns."""
    array = np.ascontiguousarray(array)
    there = empty(array.shape, array.dtype)
    given, taken, stream = array.reshape(-1), there.reshape(-1), device.stream()
    for turn, (first, last) in enumerate(_parts(array)):
        buffer = _buffer(turn)
        if turn >= 2:
            buffer.free.synchronize()
        room = buffer.room(last - first, array.dtype)
        _copy(given[first:last], room)
        taken[first:last].copy_to_device(room, stream=stream)
        buffer.free.record(stream)
    stream.synchronize()
    return there


def down(there: Any) -> NDArray[Any]:
    """A copy of an array on the GPU in the memory of the CPU, after all that is queued before."""
    array = np.empty(tuple(there.shape), there.dtype)
    given, taken, stream = there.reshape(-1), array.reshape(-1), device.stream()
    parts = list(_parts(array))
    for turn in range(len(parts) + 1):
        if turn < len(parts):
            first, last = parts[turn]
            buffer = _buffer(turn)
            room = buffer.room(last - first, array.dtype)
            given[first:last].copy_to_host(room, stream=stream)
            buffer.free.record(stream)
        if turn > 0:  # while the next part is on its way
            first, last = parts[turn - 1]
            buffer = _buffer(turn - 1)
            buffer.free.synchronize()
            _copy(buffer.room(last - first, array.dtype), taken[first:last])
    return array


class _Buffer:
    """Memory that cannot be paged out, and when the GPU has done with it."""

    def __init__(self) -> None:
        self._bytes: NDArray[np.uint8] = cuda.pinned_array(_BUFFER_BYTES, np.uint8)
        self.free = cuda.event()

    def room(self, items: int, dtype: np.dtype[Any]) -> NDArray[Any]:
        """Its beginning, for so many items."""
        return self._bytes[: items * dtype.itemsize].view(dtype)


def _buffer(turn: int) -> _Buffer:
    """One of the calling thread's two buffers, made once: pinning memory takes long."""
    if not hasattr(_of_thread, "buffers"):
        _of_thread.buffers = (_Buffer(), _Buffer())
    buffer: _Buffer = _of_thread.buffers[turn % 2]
    return buffer


def _parts(array: NDArray[Any]) -> Iterator[tuple[int, int]]:
    """First and last element of each stretch that fits into a buffer."""
    step = _BUFFER_BYTES // array.itemsize
    for first in range(0, array.size, step):
        yield first, min(first + step, array.size)


def _copy(source: NDArray[Any], target: NDArray[Any]) -> None:
    arrays_kernels.copy_bytes(source.view(np.uint8), target.view(np.uint8))


@dataclass(frozen=True, slots=True)
class DeviceEvents(Events):
    """Events of one camera, here and on the GPU, where columns x, y and t_us are `there`."""

    there: tuple[Any, Any, Any] = (None, None, None)

    @classmethod
    def of(cls, events: Events) -> DeviceEvents:
        """Uploads events; those that are on the GPU stay as they are."""
        if isinstance(events, DeviceEvents):
            return events
        x, y, t_us = (up(column) for column in (events.x, events.y, events.t_us))
        return cls(events.x, events.y, events.t_us, events.p, (x, y, t_us))

    def slice(self, start: int, stop: int) -> DeviceEvents:
        """Events `start` to `stop` (exclusive), as views."""
        part = slice(start, stop)
        x, y, t_us = (column[part] for column in self.there)
        return DeviceEvents(self.x[part], self.y[part], self.t_us[part], self.p[part], (x, y, t_us))


@dataclass(frozen=True, eq=False)
class DeviceRays:
    """Rays of one camera in the reference view, on the GPU.

    Attributes:
        blocks: each (5, N) float32 on the GPU, rows a_u, b_u, a_v, b_v, c_z as in `Rays`; events
            that do not vote have NaN.
        counts: what became of the events.
    """

    blocks: tuple[Any, ...]
    counts: RayCounts

    @classmethod
    def of(cls, rays: Rays) -> DeviceRays:
        """Uploads rays."""
        if not len(rays):
            return cls((), rays.counts)
        return cls((up(np.stack(rays.columns)),), rays.counts)

    @classmethod
    def joined(cls, parts: Sequence[DeviceRays]) -> DeviceRays:
        """All rays of several parts; nothing is copied."""
        blocks = tuple(block for part in parts for block in part.blocks)
        return cls(blocks, RayCounts.total([part.counts for part in parts]))

    def __len__(self) -> int:
        return self.counts.rays
