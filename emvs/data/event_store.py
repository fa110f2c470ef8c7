"""Events on disk in the DSEC layout: `events/{x,y,t,p}`, `ms_to_idx`, `t_offset`, in HDF5.

`t` counts microseconds from `t_offset`, and `ms_to_idx[m]` is the first event with `t >= 1000 m`:
two look-ups find a time slice, and nothing else is read. Optional columns say more of each event:
`label` (uint8, what made it) and `depth_m` (float32, z-depth of the surface that made it).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from eventsweep.emvs.data.events import Events, check_sorted
from eventsweep.emvs.data.hdf5 import (
    COMPRESSION,
    ClosingWriter,
    Hdf5Writer,
    check_dataset,
    known_names,
    open_hdf5,
)
from eventsweep.emvs.errors import InputError, located

_CHUNK = 1 << 17
_COLUMNS = {"x": np.uint16, "y": np.uint16, "t": np.int64, "p": np.uint8}
EXTRA_COLUMNS = {"label": np.uint8, "depth_m": np.float32}
"""Optional columns and their types."""

Column = NDArray[Any]


class EventStoreWriter(ClosingWriter):
    """Appends event packets to a file; memory holds one chunk and a packet, whatever the length.

    The bytes depend on the events alone, not on how they were cut into packets.
    """

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self.count = 0
        self._size_px = (width_px, height_px)
        self._waiting: list[dict[str, Column]] = []
        self._waiting_count = self._written = 0
        self._last_us: int | None = None
        self._offset_us = 0
        self._ms_to_idx: list[NDArray[np.int64]] = []
        self._next_ms = 0
        self._extra: tuple[str, ...] | None = None
        self._hdf5 = Hdf5Writer(path)
        self._file = self._hdf5.file
        for name, kind in _COLUMNS.items():
            self._create(f"events/{name}", kind, kind)
        self._create("ms_to_idx", np.uint64, np.int64)

    def append(self, events: Events, extra: Mapping[str, Column] | None = None) -> None:
        """Adds a packet that begins no earlier than the last one ended.

        `extra` are more columns (N,), named in `EXTRA_COLUMNS`; the same ones in every packet.
        """
        columns = self._checked_extra(extra or {}, len(events))
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
        t_us = events.t_us - self._offset_us
        self._waiting.append({"x": events.x, "y": events.y, "t": t_us, "p": events.p, **columns})
        self._waiting_count += len(events)
        self.count += len(events)
        if self._waiting_count >= _CHUNK:
            self._write(self._waiting_count // _CHUNK * _CHUNK)

    def close(self) -> None:
        """Writes what waits, the index and the offset."""
        if not self._file:
            return
        try:
            self._write(self._waiting_count)
            self._write_index()
            self._hdf5.create("t_offset", data=np.int64(self._offset_us))
        finally:
            self._hdf5.close()

    def _create(self, name: str, kind: DTypeLike, like: DTypeLike) -> None:
        """A growing column, compressed as those of type `like`."""
        self._hdf5.grow(name, kind, _CHUNK, **COMPRESSION[np.dtype(like)])

    def _checked_extra(self, extra: Mapping[str, Column], count: int) -> dict[str, Column]:
        names = known_names("event columns", extra, EXTRA_COLUMNS, self._extra)
        if self._extra is None:
            self._extra = names
            for name in names:
                self._create(f"events/{name}", EXTRA_COLUMNS[name], EXTRA_COLUMNS[name])
        for name, column in extra.items():
            if len(column) != count:
                raise InputError(
                    f"{len(column)} values of {name} for {count} events: needs one per event"
                )
        return {name: np.asarray(extra[name], EXTRA_COLUMNS[name]) for name in self._extra}

    def _write(self, count: int) -> None:
        """Writes the first `count` waiting events, a chunk of the file at a time."""
        if not count:
            return
        names = tuple(self._waiting[0])
        joined = {name: np.concatenate([part[name] for part in self._waiting]) for name in names}
        for start in range(0, count, _CHUNK):
            stop = min(start + _CHUNK, count)
            for name in names:
                self._hdf5.extend(f"events/{name}", joined[name][start:stop])
            self._extend_index(joined["t"][start:stop].astype(np.int64, copy=False))
            self._written += stop - start
        self._waiting_count -= count
        rest = {name: column[count:].copy() for name, column in joined.items()}
        self._waiting = [rest] if self._waiting_count else []

    def _extend_index(self, t_us: NDArray[np.int64]) -> None:
        after_ms = int(t_us[-1]) // 1000 + 1
        for first_ms in range(self._next_ms, after_ms, _CHUNK):  # a gap may last for hours
            milliseconds = np.arange(first_ms, min(first_ms + _CHUNK, after_ms)) * 1000
            self._ms_to_idx.append(self._written + np.searchsorted(t_us, milliseconds, side="left"))
            if sum(map(len, self._ms_to_idx)) >= _CHUNK:
                self._write_index()
        self._next_ms = max(self._next_ms, after_ms)

    def _write_index(self) -> None:
        """Writes the part of the index that waits."""
        self._hdf5.extend("ms_to_idx", np.concatenate([np.zeros(0, np.int64), *self._ms_to_idx]))
        self._ms_to_idx = []


class EventStoreReader:
    """Reads time slices of an event file; the file is opened for each slice and closed again."""

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self.path = Path(path)
        self._size_px = (width_px, height_px)
        with open_hdf5(self.path) as file:
            self.count = check_dataset(self.path, file["events/t"])
            counts = {check_dataset(self.path, file[f"events/{name}"]) for name in _COLUMNS}
            if counts != {self.count}:
                raise InputError(
                    f"{path}: columns have different lengths; the file is damaged, create it again"
                )
            self._offset_us = int(file["t_offset"][()])
            check_dataset(self.path, file["ms_to_idx"])
            self._ms_to_idx = file["ms_to_idx"][:].astype(np.int64)
            self.extra = tuple(name for name in EXTRA_COLUMNS if name in file["events"])
            t = file["events/t"]
            span = (int(t[0]), int(t[-1])) if self.count else (0, 0)
            self.span_us = (span[0] + self._offset_us, span[1] + self._offset_us)

    def read(self, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`."""
        with open_hdf5(self.path) as file:
            first, last, t_us = self._slice(file, t0_us, t1_us)
            x, y, p = (file[f"events/{name}"][first:last] for name in "xyp")
        return self._checked(x, y, t_us, p)

    def read_extra(self, name: str, t0_us: int, t1_us: int) -> Column:
        """An optional column of the same events."""
        if name not in self.extra:
            raise InputError(
                f"{self.path}: has no {name} per event; simulate with a sensor or truth that "
                "records it"
            )
        with open_hdf5(self.path) as file:
            first, last, _ = self._slice(file, t0_us, t1_us)
            column: Column = file[f"events/{name}"][first:last]
        return column.astype(EXTRA_COLUMNS[name], copy=False)

    def blocks(self) -> Iterator[tuple[Events, dict[str, Column]]]:
        """All events and optional columns in order, a bounded number at a time, at least once."""
        for start in range(0, max(1, self.count), 8 * _CHUNK):
            part = slice(start, start + 8 * _CHUNK)
            with open_hdf5(self.path) as file:
                x, y, t, p = (file[f"events/{name}"][part] for name in "xytp")
                extra = {name: file[f"events/{name}"][part] for name in self.extra}
            yield self._checked(x, y, t.astype(np.int64) + self._offset_us, p), extra

    def _slice(self, file: h5py.File, t0_us: int, t1_us: int) -> tuple[int, int, NDArray[np.int64]]:
        """Indices of the first event and behind the last of a time slice, and its times."""
        rows = self._bounds(t0_us - self._offset_us, t1_us - self._offset_us)
        start, stop = with_neighbours(rows, self.count)
        t_us = file["events/t"][start:stop].astype(np.int64) + self._offset_us
        slice_us = (t0_us, t1_us)
        first, last = indexed_slice(
            str(self.path), t_us, rows, self.count, slice_us, self._offset_us
        )
        return start + first, start + last, t_us[first:last]

    def _checked(self, x: Column, y: Column, t_us: NDArray[np.int64], p: Column) -> Events:
        events = Events(x.astype(np.uint16), y.astype(np.uint16), t_us, p.astype(np.uint8))
        with located(self.path):
            return events.checked(*self._size_px)

    def _bounds(self, t0: int, t1: int) -> tuple[int, int]:
        """Event indices that enclose `t0 <= t < t1` (relative µs), to the millisecond."""
        start, stop = self._first_at(t0 // 1000), self._first_at(-(-t1 // 1000))
        return start, max(start, stop)

    def _first_at(self, ms: int) -> int:
        """Index of the first event at or after a (relative) millisecond."""
        if ms <= 0:
            return 0
        return self.count if ms >= len(self._ms_to_idx) else int(self._ms_to_idx[ms])


def with_neighbours(rows: tuple[int, int], count: int) -> tuple[int, int]:
    """The rows that an index gives for a slice, and one more on either side where there is one."""
    return max(rows[0] - 1, 0), min(rows[1] + 1, count)


def indexed_slice(
    where: str,
    t_us: NDArray[np.int64],
    rows: tuple[int, int],
    count: int,
    slice_us: tuple[int, int],
    offset_us: int,
) -> tuple[int, int]:
    """Finds a time slice among the rows `with_neighbours` that an index by time gave for it.

    An index is believed about rows elsewhere. What it gives must be in order, and hold all events
    of the slice: otherwise events would be missing, or be others, without a word.

    Args:
        where: the file, for the error's sake.
        t_us: (N,) times of the rows, µs.
        rows: what the index gave, without neighbours.
        count: how many rows the file has.
        slice_us: begin, included, and end, excluded, µs.
        offset_us: where the index's first millisecond begins, µs.

    Returns:
        Begin and end of the slice among the rows.
    """
    if slice_us[0] >= slice_us[1]:
        return 0, 0
    start, stop = with_neighbours(rows, count)
    try:
        check_sorted(t_us, start)
    except InputError as error:
        raise InputError(f"{where}: {error} and rebuild ms_to_idx") from error
    first, last = np.searchsorted(t_us, slice_us, side="left").tolist()
    early, late = start > 0 and first == 0, stop < count and last == len(t_us)
    own = t_us[rows[0] - start : rows[1] - start]
    if early or late or _elsewhere(own, slice_us, offset_us):
        raise InputError(
            f"{where}, data set ms_to_idx: disagrees with events/t near row "
            f"{rows[1] if late else rows[0]} (unsorted times or a damaged index): sort the "
            "events and rebuild the index"
        )
    return first, last


def _elsewhere(t_us: NDArray[np.int64], slice_us: tuple[int, int], offset_us: int) -> bool:
    """Whether there are rows, but none in the milliseconds that a slice touches."""
    low, high = (slice_us[0] - offset_us) // 1000, -((offset_us - slice_us[1]) // 1000)
    whole_us = offset_us + 1000 * np.array([low, high])
    return bool(len(t_us) and (t_us[-1] < whole_us[0] or t_us[0] >= whole_us[1]))
