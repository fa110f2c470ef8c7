"""Reads events from HDF5 in the layouts of DSEC, TUM-VIE, MVSEC and Prophesee."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from emvs.data.events import Events
from emvs.errors import InputError
from emvs.io.events.hdf5_layouts import check_columns, hdf5_layout, offset_us, opened_hdf5
from emvs.io.events.indexed import BlockReader, IndexedBlock, within

_ROWS = 1 << 19


class Hdf5Reader(BlockReader):
    """A file of events in any of the known layouts.

    Where the file has `ms_to_idx`, a time slice costs two look-ups; the slice's neighbours are
    checked against it. Otherwise one pass over the times builds an index.

    Raises:
        InputError: a missing or damaged file, another layout, or a filter that is not installed.
    """

    def __init__(self, path: Path) -> None:
        path = Path(path)
        self._layout = hdf5_layout(path)
        super().__init__(path, tuple(self._layout.streams))
        self.format = self._layout.format
        self.width_px, self.height_px = self._layout.size_px or (None, None)
        with opened_hdf5(path) as file:
            self._count = {
                stream: check_columns(path, file, names)
                for stream, names in self._layout.streams.items()
            }
            self._has_index = "ms_to_idx" in file and len(self.streams) == 1
            if self._has_index:
                self._offset_us = offset_us(file)
                check_columns(path, file, ("ms_to_idx",))

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads the rows from front to back."""
        for start in range(0, self._count[stream], _ROWS):
            place = (start, min(start + _ROWS, self._count[stream]))
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
        if not self._has_index or not count:
            return super().span_us(stream)
        with opened_hdf5(self.path) as file:
            ends = [self._time(file, stream, k) for k in (0, count - 1)]
        return ends[0], ends[1]

    def between(self, stream: str, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`, in file order."""
        self.check_stream(stream)
        if not self._has_index:
            return super().between(stream, t0_us, t1_us)
        with opened_hdf5(self.path) as file:
            start = self._first_at(file, stream, (t0_us - self._offset_us) // 1000)
            stop = self._first_at(file, stream, -((self._offset_us - t1_us) // 1000))
            stop = max(start, stop)
            self._check_neighbours(file, stream, (start, stop), (t0_us, t1_us))
            where = self._where(stream, start, stop)
            return within(self._layout.events(file, where, stream, start, stop), t0_us, t1_us)

    def _index(self, stream: str) -> list[IndexedBlock]:
        """Reads the times alone."""
        self.check_stream(stream)
        if stream not in self._entries:
            self._entries[stream] = list(self._times(stream))
        return self._entries[stream]

    def _times(self, stream: str) -> Iterator[IndexedBlock]:
        for start in range(0, self._count[stream], _ROWS):
            place = (start, min(start + _ROWS, self._count[stream]))
            with opened_hdf5(self.path) as file:
                t_us = self._layout.times(file, self._where(stream, *place), stream, *place)
            yield IndexedBlock(place, int(t_us.min()), int(t_us.max()), len(t_us))

    def _time(self, file: h5py.File, stream: str, row: int) -> int:
        where = self._where(stream, row, row + 1)
        return int(self._layout.times(file, where, stream, row, row + 1)[0])

    def _first_at(self, file: h5py.File, stream: str, ms: int) -> int:
        """The row that `ms_to_idx` gives for a (relative) millisecond."""
        index, count = file["ms_to_idx"], self._count[stream]
        if ms <= 0:
            return 0
        row = int(index[ms]) if ms < len(index) else count
        if not 0 <= row <= count:
            raise InputError(
                f"{self.path}, data set ms_to_idx, entry {ms}: row {row} of {count}; the index is "
                "damaged, make it again"
            )
        return row

    def _check_neighbours(
        self, file: h5py.File, stream: str, rows: tuple[int, int], times_us: tuple[int, int]
    ) -> None:
        """Refuses an index that leaves out events on either side of a slice."""
        if times_us[0] >= times_us[1]:
            return
        early = rows[0] > 0 and self._time(file, stream, rows[0] - 1) >= times_us[0]
        late = rows[1] < self._count[stream] and self._time(file, stream, rows[1]) < times_us[1]
        if early or late:
            raise InputError(
                f"{self.path}, data set ms_to_idx: contradicts events/t near row "
                f"{rows[0] if early else rows[1]} (unsorted times or a damaged index): sort the "
                "events and make the index again"
            )

    def _where(self, stream: str, start: int, stop: int) -> str:
        return f"{self.path}, data set {stream}, rows {start} to {stop}"
