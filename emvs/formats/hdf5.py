"""Events in HDF5: the layouts of DSEC, TUM-VIE and MVSEC, read and written, and others, read only."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import hdf5plugin
import numpy as np
from numpy.typing import NDArray

from emvs.data.event_store import EventStoreWriter, indexed_slice, with_neighbours
from emvs.data.events import Events
from emvs.data.hdf5 import COMPRESSION, Hdf5Writer, check_dataset, open_hdf5
from emvs.errors import InputError, quoted, said, shown
from emvs.formats.base import GatheringWriter, StreamWriter
from emvs.formats.blocks import BlockReader, IndexedBlock, checked_times, times_us, to_events
from emvs.formats.columns import CURE, ColumnMap, address_of, nameless_unit_s, order_of
from emvs.formats.hdf5_kernels import convert_rows
from emvs.formats.prophesee import STREAM

Streams = dict[str, tuple[str, ...]]
_DAVIS = ("davis/left/events", "davis/right/events")
_CD = "CD/events"
_EVENTS = {name: f"events/{name}" for name in "xytp"}
_BLOCK_ROWS = 1 << 19
_SAMPLE_ROWS = 1 << 12
_CHUNK_ROWS = 1 << 16
_COLUMNS = {"x": np.uint16, "y": np.uint16, "t": np.int64, "p": np.uint8}


@contextmanager
def opened_hdf5(path: Path) -> Iterator[h5py.File]:
    """Opens a file for reading; what damage makes the library say becomes one line.

    Raises:
        InputError: a missing or damaged file.
    """
    try:
        with open_hdf5(path) as file:
            yield file
    except InputError as error:
        raise InputError(said(error, 1000)) from error
    except (ValueError, ArithmeticError, MemoryError) as error:
        raise InputError(f"{path}: damaged ({said(error)}); fetch it again") from error


@dataclass(frozen=True)
class Hdf5Layout:
    """One layout.

    Attributes:
        format: its name.
        streams: stream names, each with the data sets that hold its columns.
        events: reads rows `start` to `stop` of a stream.
        times: reads their times only, µs.
        size_px: width and height, where the file says them.
        columns: addresses of x, y, t and p, where the layout is one of columns.
        matrices: data sets of several columns, two axes each.
    """

    format: str
    streams: dict[str, tuple[str, ...]]
    events: Callable[[h5py.File, str, str, int, int], Events]
    times: Callable[[h5py.File, str, str, int, int], NDArray[np.int64]]
    size_px: tuple[int, int] | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    matrices: tuple[str, ...] = ()


def hdf5_layout(path: Path, columns: ColumnMap | None = None) -> Hdf5Layout:
    """Recognises the layout of a file by its data sets, or takes it as stated.

    Raises:
        InputError: a damaged file, or one without events in a known or the stated place.
    """
    with opened_hdf5(path) as file:
        if columns is not None and columns.x:
            return _stated(path, file, columns)
        layout = _known(path, file)
    if columns is None:
        return layout
    if layout.format not in ("e2calib", "v2e", "hdf5"):
        raise InputError(f"{path}: is {layout.format}, which says its unit; leave time_unit out")
    return _in_columns("hdf5", layout.columns, columns.unit_s or 1e-6)


def _stated(path: Path, file: h5py.File, columns: ColumnMap) -> Hdf5Layout:
    layout = _in_columns("hdf5", columns.addresses, columns.unit_s or 1e-6)
    missing = [name for name in layout.streams[STREAM] if not isinstance(file.get(name), h5py.Dataset)]
    if missing:
        there: list[str] = []
        file.visit(there.append)
        raise InputError(f"{path}: no data set {quoted(*missing)}; holds {quoted(*sorted(there))}")
    return layout


def _known(path: Path, file: h5py.File) -> Hdf5Layout:
    if _CD in file:
        fields = {name: f"{_CD}[{name}]" for name in "xytp"}
        return _in_columns("prophesee-hdf5", fields, 1e-6, _size(file))
    davis: Streams = {name.removesuffix("/events"): (name,) for name in _DAVIS if name in file}
    if davis:
        return Hdf5Layout("mvsec", davis, _matrix, _matrix_times, matrices=_DAVIS)
    if isinstance(file.get("events"), h5py.Dataset):
        return _nameless(path, file)
    there = [name for name in _EVENTS.values() if name in file]
    if len(there) == len(_EVENTS):
        return _from_offset() if "t_offset" in file else _in_columns("tumvie", _EVENTS, 1e-6)
    if there:
        missing = ", ".join(sorted(set(_EVENTS.values()) - set(there)))
        raise InputError(f"{path}: lacks {missing}; needs all of {', '.join(_EVENTS.values())}")
    if all(isinstance(file.get(name), h5py.Dataset) for name in "xytp"):
        if file["t"].dtype.kind not in "iu":
            raise InputError(f"{path}: t of type {file['t'].dtype}; state `time_unit`")
        return _in_columns("e2calib", {name: name for name in "xytp"}, 1e-6)
    raise InputError(
        f"{path}: holds {quoted(*sorted(file)) or 'nothing'}; needs events/x, y, t, p (DSEC, "
        f"TUM-VIE), {' or '.join(_DAVIS)} (MVSEC), {_CD} (Prophesee), events of (N, 4) (v2e), or "
        f"x, y, t, p (e2calib); or {CURE}"
    )


def _from_offset() -> Hdf5Layout:
    """DSEC's: columns whose times count from `t_offset`."""
    plain = _in_columns("dsec", _EVENTS, 1e-6)

    def times(file: h5py.File, *rows: Any) -> NDArray[np.int64]:
        return plain.times(file, *rows) + offset_us(file)

    def events(file: h5py.File, where: str, *rows: Any) -> Events:
        e = plain.events(file, where, *rows)
        return checked_times(Events(e.x, e.y, e.t_us + offset_us(file), e.p), where)

    return replace(plain, events=events, times=times)


def _nameless(path: Path, file: h5py.File) -> Hdf5Layout:
    """Rows of four: v2e's where they are of its type, else what their values alone allow."""
    data = file["events"]
    check_dataset(path, data)
    if data.ndim != 2 or data.shape[1] != 4 or data.dtype.kind not in "iuf":
        raise InputError(
            f"{path}, data set events: {shown(data.dtype)} of shape {data.shape}; needs numbers of "
            f"shape (N, 4), or {CURE}"
        )
    order, kind, unit_s = "txyp", "v2e", 1e-6
    if data.dtype != np.uint32:
        rows = data[-_SAMPLE_ROWS:]
        order, kind = order_of(str(path), list(rows.T)), "hdf5"
        unit_s = nameless_unit_s(str(path), rows[:, order.index("t")])
    return _in_columns(kind, {name: f"events[{order.index(name)}]" for name in "xytp"}, unit_s)


def _in_columns(
    kind: str,
    columns: Mapping[str, str],
    unit_s: float,
    size_px: tuple[int, int] | None = None,
) -> Hdf5Layout:
    """A layout whose columns lie at addresses."""
    places = [address_of(address) for address in columns.values()]
    names = tuple(dict.fromkeys(name for name, _ in places))
    matrices = tuple(name for name, key in places if key.isdecimal())
    read, times = (partial(one, columns, unit_s) for one in (_events_at, _times_at))
    return Hdf5Layout(kind, {STREAM: names}, read, times, size_px, columns, matrices)


def check_columns(
    path: Path,
    file: h5py.File,
    names: tuple[str, ...],
    axes: int = 1,
    matrices: tuple[str, ...] = (),
) -> int:
    """Rows of a stream; refuses data sets that do not match or whose bytes are not all there.

    Args:
        path: the file, for the error's sake.
        file: open.
        names: data sets that must be as long as each other.
        axes: how many each must have.
        matrices: those that must have two.

    Raises:
        InputError: as said, or a filter that is not installed.
    """
    counts = {name: check_dataset(path, file[name]) for name in names}
    for name in names:
        if file[name].ndim != (2 if name in matrices else axes):
            raise InputError(f"{path}, data set {name}: shape {file[name].shape}; of no known kind")
    if len(set(counts.values())) != 1:
        raise InputError(f"{path}: data sets of lengths {counts}; needs one length")
    return next(iter(counts.values()))


def _size(file: h5py.File) -> tuple[int, int] | None:
    words = str(file.attrs.get("geometry", "")).split("x")
    if len(words) == 2 and all(word.isdigit() for word in words):
        return int(words[0]), int(words[1])
    return None


def offset_us(file: h5py.File) -> int:
    """What times count from, µs."""
    offset = int(file["t_offset"][()]) if "t_offset" in file else 0
    if not 0 <= offset < 1 << 62:
        raise InputError(
            f"{file.filename}, data set t_offset: {offset} µs; needs 0 to 2^62 µs, damaged"
        )
    return offset


def _events_at(
    columns: Mapping[str, str], unit_s: float, file: h5py.File, where: str, stream: str,
    start: int, stop: int,
) -> Events:  # fmt: skip
    del stream
    rows: dict[str, Any] = {}
    x, y, t, p = (_column(file, columns[name], where, start, stop, rows) for name in "xytp")
    return to_events(where, x, y, times_us(where, t, unit_s), p, 1e-6)


def _times_at(
    columns: Mapping[str, str], unit_s: float, file: h5py.File, where: str, stream: str,
    start: int, stop: int,
) -> NDArray[np.int64]:  # fmt: skip
    del stream
    return times_us(where, _column(file, columns["t"], where, start, stop, {}), unit_s)


def _column(
    file: h5py.File, address: str, where: str, start: int, stop: int, rows: dict[str, Any]
) -> NDArray[Any]:
    """One column of some rows; `rows` keeps data sets that hold several."""
    name, key = address_of(address)
    data = file[name]
    if not key:
        return _numbers(where, data[start:stop])
    fields = data.dtype.names
    if fields is None and not (key.isdecimal() and data.ndim == 2 and int(key) < data.shape[1]):
        raise InputError(f"{where}: shape {data.shape} has no column {quoted(key)}")
    if fields is not None and key not in fields:
        raise InputError(f"{where}: fields {quoted(*fields)}; needs {quoted(key)}")
    if name not in rows:
        rows[name] = data[start:stop]
    return _numbers(where, np.ascontiguousarray(rows[name][key if fields else (slice(None), int(key))]))


def _numbers(where: str, values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype.kind not in "iufb" or values.dtype.itemsize > 8 or values.ndim != 1:
        raise InputError(f"{where}: {shown(values.dtype)}; needs a column of plain numbers, damaged")
    return values


def _matrix(file: h5py.File, where: str, stream: str, start: int, stop: int) -> Events:
    data = file[f"{stream}/events"]
    if data.ndim != 2 or data.shape[1] != 4:
        raise InputError(f"{where}: shape {data.shape}, needs (N, 4): x, y, t in seconds, p")
    rows = np.ascontiguousarray(data[start:stop], np.float64)
    n = len(rows)
    events = Events(
        np.empty(n, np.uint16), np.empty(n, np.uint16), np.empty(n, np.int64), np.empty(n, np.uint8)
    )
    bad = convert_rows(rows, events.x, events.y, events.t_us, events.p)
    if bad >= 0:
        raise InputError(
            f"{where}: row {start + bad} is {rows[bad].tolist()}; needs whole pixels 0 to 65535, "
            "seconds >= 0, polarity 1 or -1: the file is damaged or its columns mean something else"
        )
    return events


def _matrix_times(
    file: h5py.File, where: str, stream: str, start: int, stop: int
) -> NDArray[np.int64]:
    # A chunk holds whole rows: reading only the times would cost the same.
    return _matrix(file, where, stream, start, stop).t_us


class Hdf5Reader(BlockReader):
    """A file of events in any of the known layouts, or one whose columns are stated.

    Where the file has `ms_to_idx`, a time slice costs two look-ups; its rows and their neighbours
    are checked against it. Otherwise one pass over the times builds an index.

    Raises:
        InputError: a missing or damaged file, another layout, or a filter that is not installed.
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
            self._has_index = "ms_to_idx" in file and self.format in ("dsec", "tumvie")
            if self._has_index:
                self._offset_us = offset_us(file)
                check_columns(path, file, ("ms_to_idx",))

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
        if not self._has_index or not count:
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
        if not self._has_index:
            return super().between(stream, t0_us, t1_us)
        with opened_hdf5(self.path) as file:
            first = self._first_at(file, stream, (t0_us - self._offset_us) // 1000)
            after = self._first_at(file, stream, -((self._offset_us - t1_us) // 1000))
            rows, count = (first, max(first, after)), self._count[stream]
            start, stop = with_neighbours(rows, count)
            where = self._where(stream, start, stop)
            events = self._layout.events(file, where, stream, start, stop)
        slice_us, offset_us = (t0_us, t1_us), self._offset_us
        found = indexed_slice(str(self.path), events.t_us, rows, count, slice_us, offset_us)
        return events.slice(*found)

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

    def _last_indexed(self, file: h5py.File, stream: str) -> int:
        """The row that the last entry of `ms_to_idx` gives, or the last one there is."""
        entries = len(file["ms_to_idx"])
        last = self._first_at(file, stream, entries - 1) if entries else 0
        return min(last, self._count[stream] - 1)

    def _where(self, stream: str, start: int, stop: int) -> str:
        return f"{self.path}, data set {stream}, rows {start} to {stop}"


class DsecWriter(StreamWriter):
    """The layout of this project's own sequences, too."""

    packet = 1 << 20

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._writer = EventStoreWriter(path, width_px, height_px)

    def _put(self, stream: str, events: Events) -> None:
        del stream
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
            _create(self._hdf5, f"events/{name}", kind, (0,))
        _create(self._hdf5, "ms_to_idx", np.int64, (0,))

    def _put(self, stream: str, events: Events) -> None:
        """Writes a packet and its part of the index."""
        del stream
        for name, kind in _COLUMNS.items():
            column = getattr(events, "t_us" if name == "t" else name)
            _extend(self._hdf5, f"events/{name}", column.astype(kind, copy=False))
        after_ms = int(events.t_us[-1]) // 1000 + 1
        for first_ms in range(self._next_ms, after_ms, 1 << 20):
            stamps = np.arange(first_ms, min(first_ms + (1 << 20), after_ms)) * 1000
            rows = self._count + np.searchsorted(events.t_us, stamps, side="left")
            _extend(self._hdf5, "ms_to_idx", rows.astype(np.int64))
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
            _create(self._hdf5, name, np.float64, (0, 4))

    def _put(self, stream: str, events: Events) -> None:
        rows = np.empty((len(events), 4), np.float64)
        rows[:, 0], rows[:, 1], rows[:, 2] = events.x, events.y, events.t_us / 1e6
        rows[:, 3] = np.where(events.p > 0, 1.0, -1.0)
        _extend(self._hdf5, self._names[stream], rows)

    def _close(self) -> None:
        self._hdf5.close()


def _create(hdf5: Hdf5Writer, name: str, kind: Any, shape: tuple[int, ...]) -> None:
    kept = COMPRESSION.get(np.dtype(kind)) or hdf5plugin.Blosc(cname="lz4", clevel=5)
    hdf5.create(
        name, shape, kind, maxshape=(None, *shape[1:]), chunks=(_CHUNK_ROWS, *shape[1:]), **kept
    )


def _extend(hdf5: Hdf5Writer, name: str, rows: Any) -> None:
    with hdf5.opened(name) as data:
        count = data.shape[0]
        data.resize(count + len(rows), axis=0)
        data[count:] = rows
    hdf5.check()
