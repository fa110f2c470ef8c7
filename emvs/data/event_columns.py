"""Events in HDF5 as columns: read by rows, or by time where there is an index by milliseconds.

An index is believed about rows elsewhere. What it gives must be in order, and hold all events of
the slice: otherwise events would be missing, or be others, without a word.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import (
    LARGEST_US,
    Events,
    Numbers,
    check_sorted,
    checked_times,
    events_at,
    times_us,
)
from eventsweep.emvs.data.hdf5 import check_columns, open_hdf5
from eventsweep.emvs.data.occupied import LONGEST_SILENCE_US, Span
from eventsweep.emvs.errors import InputError, quoted, shown

BLOCK_ROWS = 1 << 19
_MOST_KEPT = 1 << 22  # more milliseconds than an hour has
_LOOKED_UP_MS = LONGEST_SILENCE_US // 2000  # so far apart no long silence lies unseen
Address = tuple[str, str]


@dataclass(frozen=True)
class EventColumns:
    """Where an HDF5 file holds the columns of a stream.

    Attributes:
        addresses: of `x`, `y`, `t` and `p`: a data set, and a field or number of a column in it,
            which is empty where the data set is the column.
        unit_s: what times count, s.
        index: data set with the first row of each millisecond, if any.
        from_offset: whether times and index count from `t_offset`.
        lacks_last: whether the index ends before the last millisecond.
        least_us: earliest time that the file may hold, µs.
    """

    addresses: dict[str, Address]
    unit_s: float = 1e-6
    index: str = ""
    from_offset: bool = False
    lacks_last: bool = False
    least_us: int = 0

    @property
    def axes(self) -> dict[str, int]:
        """Every data set, and how many axes it has."""
        return {name: 2 if key.isdecimal() else 1 for name, key in self.addresses.values()}


class ColumnReader:
    """Reads a stream; the file is opened for each slice and closed again.

    Where the file has an index, a time slice costs two look-ups.

    Attributes:
        count: how many events there are.
        is_indexed: whether slices can be read by time.
    """

    def __init__(self, path: Path, columns: EventColumns, name: str) -> None:
        self.path, self._columns, self._name = path, columns, name
        with open_hdf5(path) as file:
            self._look(file)

    def _look(self, file: h5py.File) -> None:
        """Checks that the file holds all that it declares."""
        columns = self._columns
        self.count = check_columns(self.path, file, columns.axes)
        self.is_indexed = columns.index in file
        self._offset_us = self._offset(file) if columns.from_offset else 0
        self._kept_index: Numbers | None = None
        if self.is_indexed:
            check_columns(self.path, file, {columns.index: 1})

    def _offset(self, file: h5py.File) -> int:
        stored = np.ravel(file["t_offset"][()])
        if len(stored) != 1:
            raise InputError(f"{self.path}, data set t_offset: {len(stored)} values; needs one")
        if not self._columns.least_us <= int(stored[0]) < LARGEST_US:
            raise InputError(
                f"{self.path}, data set t_offset: {stored[0]} µs; needs 0 to 2^62 µs, damaged"
            )
        return int(stored[0])

    def rows(self, start: int, stop: int) -> Events:
        """Events of rows."""
        with open_hdf5(self.path) as file:
            return self.events_of(file, start, stop)

    def events_of(self, file: h5py.File, start: int, stop: int) -> Events:
        """Events of rows of the open file."""
        kept: dict[str, Numbers] = {}
        return self._events(file, start, stop, self.times_of(file, start, stop, kept), kept)

    def _events(
        self, file: h5py.File, start: int, stop: int, t_us: NDArray[np.int64],
        kept: dict[str, Numbers],
    ) -> Events:  # fmt: skip
        x, y, p = (self._column(file, name, start, stop, kept) for name in "xyp")
        return events_at(self._where(start, stop), x, y, t_us, p)

    def times_of(
        self, file: h5py.File, start: int, stop: int, kept: dict[str, Numbers] | None = None
    ) -> NDArray[np.int64]:
        """Times of rows of the open file, µs."""
        where = self._where(start, stop)
        t = self._column(file, "t", start, stop, {} if kept is None else kept)
        t_us = times_us(where, t, self._columns.unit_s)
        if not self._offset_us:
            return t_us
        return checked_times(t_us + self._offset_us, where, self._columns.least_us)

    def _where(self, start: int, stop: int) -> str:
        return f"{self.path}, data set {self._name}, rows {start} to {stop}"

    def ends_us(self) -> tuple[int, int] | None:
        """Earliest and latest time, µs; None where only a look at all times could say it."""
        if not (self.is_indexed and self.count):
            return None
        with open_hdf5(self.path) as file:
            index = self._index(file)
            last = self._row_at(index, len(index) - 1) if len(index) else 0
            rows = 0, min(last, self.count - 1), self.count - 1
            first_us, indexed_us, last_us = (int(self.times_of(file, k, k + 1)[0]) for k in rows)
        return (first_us, last_us) if first_us <= indexed_us <= last_us else None

    def occupied_us(self) -> list[Span]:
        """First and last event of stretches without a long silence, µs, by the index."""
        if not self.count:
            return []
        with open_hdf5(self.path) as file:
            looked = [self.times_of(file, *rows) for rows in self._rows_to_look_at(file)]
        pairs = np.concatenate([np.stack([t_us[:-1], t_us[1:]], axis=1) for t_us in looked])
        wide = np.unique(pairs[pairs[:, 1] - pairs[:, 0] >= LONGEST_SILENCE_US], axis=0)
        firsts, lasts = [looked[0][0], *wide[:, 1]], [*wide[:, 0], looked[-1][-1]]
        return [(int(first), int(last)) for first, last in zip(firsts, lasts, strict=True)]

    def _rows_to_look_at(self, file: h5py.File) -> Iterator[tuple[int, int]]:
        """The first row, two around each silence, those that the index lacks, and the last."""
        index, part = self._index(file), _LOOKED_UP_MS << 10
        looks = [index[k : k + part : _LOOKED_UP_MS] for k in range(0, len(index), part)]
        rows = np.concatenate([np.zeros(1), *looks]).astype(np.int64)
        behind = max(int(index[-1]) - 1, 0) if len(index) else 0
        yield 0, 1
        for row in np.unique(rows[1:][rows[1:] == rows[:-1]]).tolist():
            if 0 < row < self.count:
                yield row - 1, row + 1
        for row in range(behind, self.count, BLOCK_ROWS - 1):
            yield row, min(row + BLOCK_ROWS, self.count)
        yield self.count - 1, self.count

    def between(self, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`, by the index."""
        with open_hdf5(self.path) as file:
            first, last, t_us = self.rows_between(file, t0_us, t1_us)
            return self._events(file, first, last, t_us, {})

    def rows_between(
        self, file: h5py.File, t0_us: int, t1_us: int
    ) -> tuple[int, int, NDArray[np.int64]]:
        """The first row of a time slice, the one behind its last, and its times, µs."""
        rows = self._indexed(file, t0_us, t1_us)
        start, stop = max(rows[0] - 1, 0), min(rows[1] + 1, self.count)
        t_us = self.times_of(file, start, stop)
        first, last = self._slice(t_us, rows, start, (t0_us, t1_us))
        return start + first, start + last, t_us[first:last]

    def _indexed(self, file: h5py.File, t0_us: int, t1_us: int) -> tuple[int, int]:
        """Rows that enclose a time slice, to the millisecond."""
        first = self._first_at(file, (t0_us - self._offset_us) // 1000)
        after = self._first_at(file, -((self._offset_us - t1_us) // 1000))
        return first, max(first, after)

    def _first_at(self, file: h5py.File, ms: int) -> int:
        """The first row from a (relative) millisecond on, as the index gives it."""
        if ms <= 0:
            return 0
        index = self._index(file)
        if ms < len(index):
            return self._row_at(index, ms)
        return self._first_behind(file, index, ms) if self._columns.lacks_last else self.count

    def _index(self, file: h5py.File) -> Numbers | h5py.Dataset:
        """The index: read once where it is of a usual length, else a data set to look up in."""
        if self._kept_index is None:
            index = file[self._columns.index]
            if len(index) > _MOST_KEPT:
                return index
            self._kept_index = index[:]
        return self._kept_index

    def _row_at(self, index: Numbers | h5py.Dataset, ms: int) -> int:
        row = int(index[ms])
        if not 0 <= row <= self.count:
            raise InputError(
                f"{self.path}, data set {self._columns.index}, entry {ms}: points to row {row} of "
                f"{self.count}; the index is damaged, rebuild it"
            )
        return row

    def _first_behind(self, file: h5py.File, index: Numbers | h5py.Dataset, ms: int) -> int:
        """The first row from a millisecond on that the index does not reach.

        Only the rows behind its last entry are looked at.
        """
        first = self._row_at(index, len(index) - 1) if len(index) else 0
        for start in range(first, self.count, BLOCK_ROWS):
            t_us = self.times_of(file, start, min(start + BLOCK_ROWS, self.count))
            if t_us[-1] >= 1000 * ms:
                return start + int(np.searchsorted(t_us, 1000 * ms))
        return self.count

    def _slice(
        self, t_us: NDArray[np.int64], rows: tuple[int, int], start: int, slice_us: tuple[int, int]
    ) -> tuple[int, int]:
        """Begin and end of a time slice among (N,) times: of what the index gave, and neighbours.

        Args:
            t_us: times of the rows from `start` on.
            rows: what the index gave.
            start: the first of the times' rows.
            slice_us: begin, included, and end, excluded, µs.
        """
        if slice_us[0] >= slice_us[1]:
            return 0, 0
        try:
            check_sorted(t_us, start)
        except InputError as error:
            raise InputError(f"{self.path}: {error} and rebuild ms_to_idx") from error
        first, last = np.searchsorted(t_us, slice_us, side="left").tolist()
        early, late = start > 0 and first == 0, start + len(t_us) < self.count and last == len(t_us)
        if early or late or self._is_elsewhere(t_us[rows[0] - start : rows[1] - start], slice_us):
            raise InputError(
                f"{self.path}, data set {self._columns.index}: disagrees with "
                f"{self._columns.addresses['t'][0]} near row {rows[1] if late else rows[0]} "
                "(unsorted times or a damaged index): sort the events and rebuild the index"
            )
        return first, last

    def _is_elsewhere(self, t_us: NDArray[np.int64], slice_us: tuple[int, int]) -> bool:
        """Whether there are rows, but none in the milliseconds that a slice touches."""
        offset_us = self._offset_us
        low, high = (slice_us[0] - offset_us) // 1000, -((offset_us - slice_us[1]) // 1000)
        low_us, high_us = offset_us + 1000 * low, offset_us + 1000 * high
        return bool(len(t_us) and (t_us[-1] < low_us or t_us[0] >= high_us))

    def _column(
        self, file: h5py.File, what: str, start: int, stop: int, kept: dict[str, Numbers]
    ) -> Numbers:
        """One column of some rows; `kept` holds rows of data sets with several."""
        name, key = self._columns.addresses[what]
        data, where = file[name], self._where(start, stop)
        if not key:
            return _numbers(where, data[start:stop])
        fields = data.dtype.names
        if fields is None and not (key.isdecimal() and int(key) < data.shape[1]):
            raise InputError(f"{where}: shape {data.shape} has no column {quoted(key)}")
        if fields is not None and key not in fields:
            raise InputError(f"{where}: fields {quoted(*fields)}; needs {quoted(key)}")
        if name not in kept:
            kept[name] = data[start:stop]
        place = key if fields else (slice(None), int(key))
        return _numbers(where, np.ascontiguousarray(kept[name][place]))


def _numbers(where: str, values: Numbers) -> Numbers:
    if values.dtype.kind not in "iufb" or values.dtype.itemsize > 8 or values.ndim != 1:
        raise InputError(
            f"{where}: {shown(values.dtype)}; needs a column of plain numbers, damaged"
        )
    return values
