"""Events on disk in the DSEC layout: `events/{x,y,t,p}`, `ms_to_idx`, `t_offset`, in HDF5.

`t` counts microseconds from `t_offset`, and `ms_to_idx[m]` is the first event with `t >= 1000 m`:
two look-ups find a time slice, and nothing else is read.
"""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events
from emvs.data.hdf5 import COMPRESSION, Hdf5Writer, open_hdf5
from emvs.errors import InputError

_CHUNK = 1 << 17
_COLUMNS = {"x": np.uint16, "y": np.uint16, "t": np.int64, "p": np.uint8}


class EventWriter:
    """Appends event packets to a file; memory holds one chunk, whatever the length."""

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self.count = 0
        self._size_px = (width_px, height_px)
        self._waiting: list[Events] = []
        self._last_us: int | None = None
        self._offset_us = 0
        self._ms_to_idx = np.zeros(0, np.int64)
        self._hdf5 = Hdf5Writer(path)
        self._file = self._hdf5.file
        for name, kind in _COLUMNS.items():
            self._file.create_dataset(
                f"events/{name}",
                (0,),
                kind,
                maxshape=(None,),
                chunks=(_CHUNK,),
                **COMPRESSION[np.dtype(kind)],
            )

    def append(self, events: Events) -> None:
        """Adds a packet that begins no earlier than the last one ended.

        Raises:
            InputError: unsorted or out-of-sensor events, or a packet out of order.
        """
        if not len(events):
            return
        events.checked(*self._size_px)
        if self._last_us is not None and events.t_us[0] < self._last_us:
            raise InputError(
                f"event packet begins at {events.t_us[0]} µs, before the last event written "
                f"({self._last_us} µs): append packets in time order"
            )
        if self._last_us is None:
            self._offset_us = int(events.t_us[0]) // 1000 * 1000
        self._last_us = int(events.t_us[-1])
        self._waiting.append(events)
        self.count += len(events)
        if sum(map(len, self._waiting)) >= _CHUNK:
            self._flush()

    def close(self) -> None:
        """Writes what waits, the index and the offset."""
        if not self._file:
            return
        try:
            self._flush()
            self._file.create_dataset("ms_to_idx", data=self._ms_to_idx.astype(np.uint64))
            self._file.create_dataset("t_offset", data=np.int64(self._offset_us))
        finally:
            self._hdf5.close()

    def __enter__(self) -> EventWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _flush(self) -> None:
        events = Events.concat(self._waiting)
        self._waiting = []
        start = self._file["events/t"].shape[0]
        t_us = events.t_us - self._offset_us
        for name, column in zip(_COLUMNS, (events.x, events.y, t_us, events.p), strict=True):
            dataset = self._file[f"events/{name}"]
            dataset.resize((start + len(events),))
            dataset[start:] = column
        self._hdf5.check()
        self._extend_index(t_us, start)

    def _extend_index(self, t_us: NDArray[np.int64], start: int) -> None:
        if not len(t_us):
            return
        milliseconds = np.arange(len(self._ms_to_idx), int(t_us[-1]) // 1000 + 1) * 1000
        found = start + np.searchsorted(t_us, milliseconds, side="left")
        self._ms_to_idx = np.concatenate([self._ms_to_idx, found])


class EventReader:
    """Reads time slices of an event file; the file is opened for each slice and closed again.

    Raises:
        InputError: a missing or truncated file, or one of another layout.
    """

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self.path = Path(path)
        self._size_px = (width_px, height_px)
        with open_hdf5(self.path) as file:
            self.count = len(file["events/t"])
            if any(len(file[f"events/{name}"]) != self.count for name in _COLUMNS):
                raise InputError(
                    f"{path}: columns of different length; the file is damaged, make it again"
                )
            self._offset_us = int(file["t_offset"][()])
            self._ms_to_idx = file["ms_to_idx"][:].astype(np.int64)
            t = file["events/t"]
            span = (int(t[0]), int(t[-1])) if self.count else (0, 0)
            self.span_us = (span[0] + self._offset_us, span[1] + self._offset_us)

    def read(self, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`."""
        start, stop = self._bounds(t0_us - self._offset_us, t1_us - self._offset_us)
        with open_hdf5(self.path) as file:
            t_us = file["events/t"][start:stop].astype(np.int64) + self._offset_us
            first, last = start + np.searchsorted(t_us, [t0_us, t1_us], side="left")
            x, y, p = (file[f"events/{name}"][first:last] for name in "xyp")
        events = Events(
            x.astype(np.uint16),
            y.astype(np.uint16),
            t_us[first - start : last - start],
            p.astype(np.uint8),
        )
        try:
            return events.checked(*self._size_px)
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error

    def _bounds(self, t0: int, t1: int) -> tuple[int, int]:
        """Event indices that enclose `t0 <= t < t1` (relative µs), to the millisecond."""
        start, stop = self._first_at(t0 // 1000), self._first_at(-(-t1 // 1000))
        return start, max(start, stop)

    def _first_at(self, ms: int) -> int:
        """Index of the first event at or after a (relative) millisecond."""
        if ms <= 0:
            return 0
        return self.count if ms >= len(self._ms_to_idx) else int(self._ms_to_idx[ms])
