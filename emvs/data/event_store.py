"""Events on disk in the DSEC layout: `events/{x,y,t,p}`, `ms_to_idx`, `t_offset`, in HDF5.

`t` counts microseconds from `t_offset`, and `ms_to_idx[m]` is the first event with `t >= 1000 m`:
two look-ups find a time slice, and nothing else is read. Optional columns say more of each event:
`label` (uint8, what made it) and `depth_m` (float32, z-depth of the surface that made it).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from eventsweep.emvs.data.event_columns import ColumnReader, EventColumns
from eventsweep.emvs.data.events import LARGEST_US, Events, Numbers, check_span
from eventsweep.emvs.data.hdf5 import (
    COMPRESSION,
    ClosingWriter,
    Hdf5Writer,
    known_names,
    open_hdf5,
)
from eventsweep.emvs.errors import InputError, located

_CHUNK = 1 << 17
COLUMNS = {"x": np.uint16, "y": np.uint16, "t": np.int64, "p": np.uint8}
EXTRA_COLUMNS = {"label": np.uint8, "depth_m": np.float32}
"""Optional columns and their types."""

STORE = EventColumns(
    {name: (f"events/{name}", "") for name in "xytp"},
    index="ms_to_idx",
    from_offset=True,
    least_us=-LARGEST_US,
)


class EventStoreWriter(ClosingWriter):
    """Appends event packets to a file; memory holds one chunk and a packet, whatever the length.

    The bytes depend on the events alone, not on how they were cut into packets.
    """

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self.count = 0
        self._size_px = (width_px, height_px)
        self._waiting: list[dict[str, Numbers]] = []
        self._waiting_count = self._written = 0
        self._last_us: int | None = None
        self._offset_us = 0
        self._ms_to_idx: list[NDArray[np.int64]] = []
        self._next_ms = 0
        self._extra: tuple[str, ...] | None = None
        self._hdf5 = Hdf5Writer(path)
        self._file = self._hdf5.file
        for name, kind in COLUMNS.items():
            self._create(f"events/{name}", kind, kind)
        self._create("ms_to_idx", np.uint64, np.int64)

    def append(self, events: Events, extra: Mapping[str, Numbers] | None = None) -> None:
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
        check_span(self._offset_us, self._last_us, events.t_us)
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

    def _checked_extra(self, extra: Mapping[str, Numbers], count: int) -> dict[str, Numbers]:
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
        for rows in index_parts(t_us, self._next_ms, self._written, _CHUNK):
            self._ms_to_idx.append(rows)
            self._next_ms += len(rows)
            if sum(map(len, self._ms_to_idx)) >= _CHUNK:
                self._write_index()

    def _write_index(self) -> None:
        """Writes the part of the index that waits."""
        self._hdf5.extend("ms_to_idx", np.concatenate([np.zeros(0, np.int64), *self._ms_to_idx]))
        self._ms_to_idx = []


def index_parts(
    t_us: NDArray[np.int64], next_ms: int, written: int, most: int
) -> Iterator[NDArray[np.int64]]:
    """First rows of the milliseconds from the next one on, in parts: a gap may last for hours.

    Args:
        t_us: (N,) times of events to write, µs.
        next_ms: the first millisecond without an entry.
        written: how many events are written before these.
        most: entries of a part.
    """
    after_ms = int(t_us[-1]) // 1000 + 1
    for first_ms in range(next_ms, after_ms, most):
        stamps_us = np.arange(first_ms, min(first_ms + most, after_ms)) * 1000
        yield written + np.searchsorted(t_us, stamps_us, side="left").astype(np.int64)


class EventStoreReader(ColumnReader):
    """Reads time slices of an event file; `extra` names its optional columns."""

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._size_px = (width_px, height_px)
        super().__init__(Path(path), STORE, "events")

    def _look(self, file: h5py.File) -> None:
        super()._look(file)
        if not self.is_indexed:
            raise InputError(f"{self.path}: not in the expected layout, lacks {STORE.index}")
        self.extra = tuple(name for name in EXTRA_COLUMNS if name in file["events"])

    def read(self, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`."""
        events = self.between(t0_us, t1_us)
        with located(self.path):
            events.check_inside(*self._size_px)
        return events

    def read_extra(self, name: str, t0_us: int, t1_us: int) -> Numbers:
        """An optional column of the same events."""
        if name not in self.extra:
            raise InputError(
                f"{self.path}: has no {name} per event; simulate with a sensor or truth that "
                "records it"
            )
        with open_hdf5(self.path) as file:
            first, last, _ = self.rows_between(file, t0_us, t1_us)
            column: Numbers = file[f"events/{name}"][first:last]
        return column.astype(EXTRA_COLUMNS[name], copy=False)

    def blocks(self) -> Iterator[tuple[Events, dict[str, Numbers]]]:
        """All events and optional columns in order, a bounded number at a time, at least once."""
        for start in range(0, max(1, self.count), 8 * _CHUNK):
            stop = min(start + 8 * _CHUNK, self.count)
            with open_hdf5(self.path) as file, located(self.path):
                events = self.events_of(file, start, stop).checked(*self._size_px)
                extra = {name: file[f"events/{name}"][start:stop] for name in self.extra}
            yield events, extra
