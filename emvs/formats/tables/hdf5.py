"""Events in HDF5: in the layouts of DSEC, TUM-VIE, MVSEC, M3ED and others, or in any columns.

The first three are written, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import hdf5plugin
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.event_store import EventStoreWriter, indexed_slice, with_neighbours
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.hdf5 import COMPRESSION, Hdf5Writer
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.base import GatheringWriter, StreamWriter
from eventsweep.emvs.formats.blocks import BlockReader, IndexedBlock, checked_times
from eventsweep.emvs.formats.tables.columns import ColumnMap
from eventsweep.emvs.formats.tables.hdf5_layouts import (
    check_columns,
    hdf5_layout,
    offset_us,
    opened_hdf5,
)

_BLOCK_ROWS = 1 << 19
_CHUNK_ROWS = 1 << 16
_COLUMNS = {"x": np.uint16, "y": np.uint16, "t": np.int64, "p": np.uint8}


class Hdf5Reader(BlockReader):
    """A file of events in any of the known layouts, or one whose columns are stated.

    Where the file has an index by milliseconds, a time slice costs two look-ups; its rows and their
    neighbours are checked against it. Otherwise one pass over the times builds an index.
    """

    def __init__(self, path: Path, columns: ColumnMap | None = None) -> None:
        path = Path(path)
        self._layout = hdf5_layout(path, columns)
        super().__init__(path, tuple(self._layout.streams))
        self.format = self._layout.format
        self.width_px, self.height_px = self._layout.size_px or (None, None)
        with opened_hdf5(path) as file:
            self._count = {
                stream: check_columns(path, file, names, matrices=self._layout.matrices)
                for stream, names in self._layout.streams.items()
            }
            names = {stream: self._layout.index.format(stream=stream) for stream in self.streams}
            self._index_of = {stream: name for stream, name in names.items() if name in file}
            if self._index_of:
                self._offset_us = offset_us(file)
            for name in self._index_of.values():
                check_columns(path, file, (name,))

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads the rows from front to back."""
        for start in range(0, self._count[stream], _BLOCK_ROWS):
            place = (start, min(start + _BLOCK_ROWS, self._count[stream]))
            yield place, self.load(stream, place)

    def load(self, stream: str, place: Any) -> Events:
        """Reads a range of rows."""
        with opened_hdf5(self.path) as file:
            return self._layout.events(file, self._where(stream, *place), stream, *place)

    def share_before(self, stream: str, place: Any) -> float:
        """Which share of the rows ends with a block."""
        return float(place[1] / max(1, self._count[stream]))

    def span_us(self, stream: str) -> tuple[int, int]:
        """Earliest and latest time stamp, µs."""
        self.check_stream(stream)
        count = self._count[stream]
        if stream not in self._index_of or not count:
            return super().span_us(stream)
        with opened_hdf5(self.path) as file:
            rows = 0, self._last_indexed(file, stream), count - 1
            times = [self._time(file, stream, row) for row in rows]
        if times != sorted(times):  # the ends are not the earliest and the latest
            return super().span_us(stream)
        return times[0], times[2]

    def between(self, stream: str, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`, in file order."""
        self.check_stream(stream)
        if stream not in self._index_of:
            return super().between(stream, t0_us, t1_us)
        with opened_hdf5(self.path) as file:
            first = self._first_at(file, stream, (t0_us - self._offset_us) // 1000)
            after = self._first_at(file, stream, -((self._offset_us - t1_us) // 1000))
            rows, count = (first, max(first, after)), self._count[stream]
            start, stop = with_neighbours(rows, count)
            where = self._where(stream, start, stop)
            events = self._layout.events(file, where, stream, start, stop)
        slice_us, offset_us = (t0_us, t1_us), self._offset_us
        part = indexed_slice(str(self.path), events.t_us, rows, count, slice_us, offset_us)
        return events.slice(*part)

    def _index(self, stream: str) -> list[IndexedBlock]:
        """Reads the times alone."""
        self.check_stream(stream)
        if stream not in self._entries:
            self._entries[stream] = list(self._times(stream))
        return self._entries[stream]

    def _times(self, stream: str) -> Iterator[IndexedBlock]:
        for start in range(0, self._count[stream], _BLOCK_ROWS):
            place = (start, min(start + _BLOCK_ROWS, self._count[stream]))
            with opened_hdf5(self.path) as file:
                t_us = self._rows_us(file, stream, *place)
            yield IndexedBlock(place, int(t_us.min()), int(t_us.max()), len(t_us))

    def _time(self, file: h5py.File, stream: str, row: int) -> int:
        return int(self._rows_us(file, stream, row, row + 1)[0])

    def _rows_us(self, file: h5py.File, stream: str, start: int, stop: int) -> NDArray[np.int64]:
        """Times of rows, checked."""
        where = self._where(stream, start, stop)
        return checked_times(self._layout.times(file, where, stream, start, stop), where)

    def _first_at(self, file: h5py.File, stream: str, ms: int) -> int:
        """The row that the index gives for a (relative) millisecond."""
        name, count = self._index_of[stream], self._count[stream]
        index = file[name]
        if ms <= 0:
            return 0
        if ms >= len(index):
            return self._first_behind(file, stream, ms) if self.format == "m3ed" else count
        row = int(index[ms])
        if not 0 <= row <= count:
            raise InputError(
                f"{self.path}, data set {name}, entry {ms}: points to row {row} of {count}; the "
                "index is damaged, rebuild it"
            )
        return row

    def _first_behind(self, file: h5py.File, stream: str, ms: int) -> int:
        """The first row from a millisecond on that the index does not reach: M3ED's lacks the last.

        Only the rows behind its last entry are looked at.
        """
        entries, count = len(file[self._index_of[stream]]), self._count[stream]
        first = self._first_at(file, stream, entries - 1) if entries else 0
        for start in range(first, count, _BLOCK_ROWS):
            stop = min(start + _BLOCK_ROWS, count)
            t_us = self._rows_us(file, stream, start, stop)
            if t_us[-1] >= 1000 * ms:
                return start + int(np.searchsorted(t_us, 1000 * ms))
        return count

    def _last_indexed(self, file: h5py.File, stream: str) -> int:
        """The row that the last entry of the index gives, or the last one there is."""
        entries = len(file[self._index_of[stream]])
        last = self._first_at(file, stream, entries - 1) if entries else 0
        return min(last, self._count[stream] - 1)

    def _where(self, stream: str, start: int, stop: int) -> str:
        return f"{self.path}, data set {stream}, rows {start} to {stop}"


class DsecWriter(StreamWriter):
    """The layout of this project's own sequences, too."""

    packet = 1 << 20

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._writer = EventStoreWriter(path, width_px, height_px)

    def _put(self, _stream: str, events: Events) -> None:
        self._writer.append(events)

    def _close(self) -> None:
        self._writer.close()


class TumvieWriter(GatheringWriter):
    """Columns with `ms_to_idx`, and no offset: times count from the recording's zero."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._hdf5 = Hdf5Writer(path)
        self._count = self._next_ms = 0
        for name, kind in _COLUMNS.items():
            _grow(self._hdf5, f"events/{name}", kind)
        _grow(self._hdf5, "ms_to_idx", np.int64)

    def _put(self, _stream: str, events: Events) -> None:
        """Writes a packet and its part of the index."""
        for name, kind in _COLUMNS.items():
            column = getattr(events, "t_us" if name == "t" else name)
            self._hdf5.extend(f"events/{name}", column.astype(kind, copy=False))
        after_ms = int(events.t_us[-1]) // 1000 + 1
        for first_ms in range(self._next_ms, after_ms, 1 << 20):
            stamps = np.arange(first_ms, min(first_ms + (1 << 20), after_ms)) * 1000
            rows = self._count + np.searchsorted(events.t_us, stamps, side="left")
            self._hdf5.extend("ms_to_idx", rows.astype(np.int64))
        self._next_ms = max(self._next_ms, after_ms)
        self._count += len(events)

    def _close(self) -> None:
        self._hdf5.close()


class MvsecWriter(GatheringWriter):
    """`davis/left/events` and `davis/right/events`: rows of x, y, t in seconds, p as -1 or 1."""

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        super().__init__()
        sides = {name: name.rpartition("/")[2] for name in names}
        if set(sides.values()) - {"left", "right"}:
            sides = dict(zip(names, ("left", "right"), strict=False))
        if len(set(sides.values())) < len(names):
            raise InputError(f"{path}: streams {', '.join(names)}; needs a left and a right one")
        self._names = {name: f"davis/{side}/events" for name, side in sides.items()}
        self._hdf5 = Hdf5Writer(path)
        for name in self._names.values():
            _grow(self._hdf5, name, np.float64, 4)

    def _put(self, stream: str, events: Events) -> None:
        rows = np.empty((len(events), 4), np.float64)
        rows[:, 0], rows[:, 1], rows[:, 2] = events.x, events.y, events.t_us / 1e6
        rows[:, 3] = np.where(events.p > 0, 1.0, -1.0)
        self._hdf5.extend(self._names[stream], rows)

    def _close(self) -> None:
        self._hdf5.close()


def _grow(hdf5: Hdf5Writer, name: str, kind: Any, *shape: int) -> None:
    kept = COMPRESSION.get(np.dtype(kind)) or hdf5plugin.Blosc(cname="lz4", clevel=5)
    hdf5.grow(name, kind, _CHUNK_ROWS, shape, **kept)
