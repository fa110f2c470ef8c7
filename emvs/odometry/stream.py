"""The newest events of a camera: pushed at one end, let go at the other."""

from __future__ import annotations

import numpy as np

from eventsweep.emvs.data.events import Events

_COLUMNS = (("x", np.uint16), ("y", np.uint16), ("t_us", np.int64), ("p", np.uint8))
_ROOM = 1 << 16


class Stream:
    """Events in order of time, as one stretch of memory; what was let go takes none."""

    def __init__(self) -> None:
        self._columns = {name: np.empty(_ROOM, kind) for name, kind in _COLUMNS}
        self._first = self._last = 0

    def __len__(self) -> int:
        return self._last - self._first

    def push(self, events: Events) -> None:
        """Takes events that are not older than those before."""
        if self._last + len(events) > len(self._columns["t_us"]):
            self._move(len(self) + len(events))
        for name, column in self._columns.items():
            column[self._last : self._last + len(events)] = getattr(events, name)
        self._last += len(events)

    def between(self, t0_us: int, t1_us: int) -> Events:
        """A copy of the events with `t0_us <= t < t1_us`."""
        first, last = self._first + np.searchsorted(self._times(), [t0_us, t1_us], side="left")
        return Events(*(column[first:last].copy() for column in self._columns.values()))

    def time_of_newest(self, count: int, t_us: int) -> int | None:
        """When the last `count` events before `t_us` begin, µs; None if there are not so many."""
        last = int(np.searchsorted(self._times(), t_us, side="left"))
        return int(self._times()[last - count]) if last >= count else None

    def drop_before(self, t_us: int) -> None:
        """Lets go of older events."""
        self._first += int(np.searchsorted(self._times(), t_us, side="left"))

    def _times(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        times: np.ndarray[tuple[int], np.dtype[np.int64]] = self._columns["t_us"][
            self._first : self._last
        ]
        return times

    def _move(self, needed: int) -> None:
        """Makes room at the end, for twice what is needed, but for no more than that."""
        room = max(_ROOM, 2 * needed)
        for name, column in self._columns.items():
            fresh = np.empty(room, column.dtype)
            fresh[: len(self)] = column[self._first : self._last]
            self._columns[name] = fresh
        self._first, self._last = 0, len(self)
