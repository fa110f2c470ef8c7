"""Which data sets of an HDF5 file hold events, and how their rows are read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.hdf5 import check_dataset, open_hdf5
from eventsweep.emvs.errors import InputError, quoted, said, shown
from eventsweep.emvs.formats.blocks import checked_times, times_us, to_events
from eventsweep.emvs.formats.prophesee import STREAM
from eventsweep.emvs.formats.tables.columns import (
    CURE,
    ColumnMap,
    address_of,
    nameless_unit_s,
    order_of,
)
from eventsweep.emvs.formats.tables.hdf5_kernels import convert_rows

Streams = dict[str, tuple[str, ...]]
_DAVIS = ("davis/left/events", "davis/right/events")
_CD = "CD/events"
_PROPHESEE = ("prophesee/left", "prophesee/right")
_EVENTS = {name: f"events/{name}" for name in "xytp"}
_SAMPLE_ROWS = 1 << 12


@contextmanager
def opened_hdf5(path: Path) -> Iterator[h5py.File]:
    """Opens a file for reading; what damage makes the library say becomes one line."""
    try:
        with open_hdf5(path) as file:
            yield file
    except InputError as error:
        raise InputError(said(error, 1000)) from error
    except (ValueError, ArithmeticError, MemoryError) as error:
        raise InputError(f"{path}: damaged ({said(error)}); download it again") from error


@dataclass(frozen=True)
class Hdf5Layout:
    """One layout.

    Attributes:
        format: its name.
        streams: stream names, each with the data sets that hold its columns.
        events: reads rows `start` to `stop` of a stream.
        times: reads their times only, µs.
        size_px: width and height, where the file says them.
        matrices: data sets of several columns, two axes each.
        index: data set with the first row of each millisecond, if any; `{stream}` stands for its
            name.
    """

    format: str
    streams: dict[str, tuple[str, ...]]
    events: Callable[[h5py.File, str, str, int, int], Events]
    times: Callable[[h5py.File, str, str, int, int], NDArray[np.int64]]
    size_px: tuple[int, int] | None = None
    matrices: tuple[str, ...] = ()
    index: str = ""


def hdf5_layout(path: Path, columns: ColumnMap | None = None) -> Hdf5Layout:
    """Recognises the layout of a file by its data sets, or takes it as stated."""
    with opened_hdf5(path) as file:
        if columns is not None and columns.x:
            return _stated(path, file, columns)
        layout = _known(path, file, columns.unit_s if columns is not None else None)
    if columns is not None and layout.format not in ("e2calib", "v2e", "hdf5"):
        raise InputError(
            f"{path}: is {layout.format}, which defines its time unit; leave `time_unit` out"
        )
    return layout


def _stated(path: Path, file: h5py.File, columns: ColumnMap) -> Hdf5Layout:
    layout = _in_columns("hdf5", columns.addresses, columns.unit_s or 1e-6)
    missing = [
        name for name in layout.streams[STREAM] if not isinstance(file.get(name), h5py.Dataset)
    ]
    if missing:
        there: list[str] = []
        file.visit(there.append)
        raise InputError(f"{path}: no data set {quoted(*missing)}; holds {quoted(*sorted(there))}")
    return layout


def _known(path: Path, file: h5py.File, unit_s: float | None) -> Hdf5Layout:
    if _CD in file:
        fields = {name: f"{_CD}[{name}]" for name in "xytp"}
        return _in_columns("prophesee-hdf5", fields, 1e-6, _size(file))
    davis: Streams = {name.removesuffix("/events"): (name,) for name in _DAVIS if name in file}
    if davis:
        return Hdf5Layout("mvsec", davis, _matrix, _matrix_times, matrices=_DAVIS)
    if any(name in file for name in _PROPHESEE):
        return _in_groups(path, file)
    if isinstance(file.get("events"), h5py.Dataset):
        return _nameless(path, file, unit_s)
    there = [name for name in _EVENTS.values() if name in file]
    if len(there) == len(_EVENTS):
        return _from_offset() if "t_offset" in file else replace(
            _in_columns("tumvie", _EVENTS, 1e-6), index="ms_to_idx"
        )  # fmt: skip
    if there:
        missing = ", ".join(sorted(set(_EVENTS.values()) - set(there)))
        raise InputError(f"{path}: lacks {missing}; needs all of {', '.join(_EVENTS.values())}")
    if all(isinstance(file.get(name), h5py.Dataset) for name in "xytp"):
        if file["t"].dtype.kind not in "iu" and unit_s is None:
            raise InputError(f"{path}: t of type {file['t'].dtype}; set `time_unit`")
        return _in_columns("e2calib", {name: name for name in "xytp"}, unit_s or 1e-6)
    raise InputError(
        f"{path}: holds {quoted(*sorted(file)) or 'nothing'}; needs events/x, y, t, p (DSEC, "
        f"TUM-VIE), {' or '.join(_DAVIS)} (MVSEC), {' or '.join(_PROPHESEE)} (M3ED), {_CD} "
        f"(Prophesee), events of (N, 4) (v2e), or x, y, t, p (e2calib); or {CURE}"
    )


def _from_offset() -> Hdf5Layout:
    """DSEC's: columns whose times count from `t_offset`."""
    plain = _in_columns("dsec", _EVENTS, 1e-6)

    def times(file: h5py.File, *rows: Any) -> NDArray[np.int64]:
        return plain.times(file, *rows) + offset_us(file)

    def events(file: h5py.File, where: str, *rows: Any) -> Events:
        found = plain.events(file, where, *rows).shifted(offset_us(file))
        checked_times(found.t_us, where)
        return found

    return replace(plain, events=events, times=times, index="ms_to_idx")


def _in_groups(path: Path, file: h5py.File) -> Hdf5Layout:
    """M3ED's: the columns of each camera in a group of its own."""
    there = [name for name in _PROPHESEE if name in file]
    streams = {name: tuple(f"{name}/{column}" for column in "xytp") for name in there}
    missing = [name for names in streams.values() for name in names if name not in file]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; download it again")
    plain = _in_columns("m3ed", {name: name for name in "xytp"}, 1e-6)

    def events(file: h5py.File, where: str, stream: str, *rows: Any) -> Events:
        return plain.events(file[stream], where, stream, *rows)

    def times(file: h5py.File, where: str, stream: str, *rows: Any) -> NDArray[np.int64]:
        return plain.times(file[stream], where, stream, *rows)

    return Hdf5Layout("m3ed", streams, events, times, index="{stream}/ms_map_idx")


def _nameless(path: Path, file: h5py.File, unit_s: float | None) -> Hdf5Layout:
    """Rows of four: v2e's where they are of its type, else what their values alone allow."""
    data = file["events"]
    check_dataset(path, data)
    if data.ndim != 2 or data.shape[1] != 4 or data.dtype.kind not in "iuf":
        raise InputError(
            f"{path}, data set events: {shown(data.dtype)} of shape {data.shape}; needs numbers of "
            f"shape (N, 4), or {CURE}"
        )
    order, kind = "txyp", "v2e"
    if data.dtype != np.uint32:
        rows = data[-_SAMPLE_ROWS:]
        order, kind = order_of(str(path), list(rows.T)), "hdf5"
        unit_s = unit_s or nameless_unit_s(str(path), rows[:, order.index("t")])
    return _in_columns(
        kind, {name: f"events[{order.index(name)}]" for name in "xytp"}, unit_s or 1e-6
    )


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
    events, times = partial(_events_at, columns, unit_s), partial(_times_at, columns, unit_s)
    return Hdf5Layout(kind, {STREAM: names}, events, times, size_px, matrices)


def check_columns(
    path: Path,
    file: h5py.File,
    names: tuple[str, ...],
    axes: int = 1,
    matrices: tuple[str, ...] = (),
) -> int:
    """Rows of a stream; refuses data sets that do not match or whose bytes are not all there.

    All must be of one length and have so many axes, but for `matrices`, which have two.
    """
    counts = {name: check_dataset(path, file[name]) for name in names}
    for name in names:
        if file[name].ndim != (2 if name in matrices else axes):
            raise InputError(
                f"{path}, data set {name}: shape {file[name].shape}, which is not supported"
            )
    if len(set(counts.values())) != 1:
        raise InputError(f"{path}: data sets of different lengths {counts}; needs equal lengths")
    return next(iter(counts.values()))


def _size(file: h5py.File) -> tuple[int, int] | None:
    words = str(file.attrs.get("geometry", "")).split("x")
    if len(words) == 2 and all(word.isdigit() for word in words):
        return int(words[0]), int(words[1])
    return None


def offset_us(file: h5py.File) -> int:
    """What times count from, µs."""
    stored = np.ravel(file["t_offset"][()]) if "t_offset" in file else np.zeros(1, np.int64)
    if len(stored) != 1:
        raise InputError(f"{file.filename}, data set t_offset: {len(stored)} values; needs one")
    offset = int(stored[0])
    if not 0 <= offset < 1 << 62:
        raise InputError(
            f"{file.filename}, data set t_offset: {offset} µs; needs 0 to 2^62 µs, damaged"
        )
    return offset


def _events_at(
    columns: Mapping[str, str], unit_s: float, file: h5py.File, where: str, _stream: str,
    start: int, stop: int,
) -> Events:  # fmt: skip
    rows: dict[str, Any] = {}
    x, y, t, p = (_column(file, columns[name], where, start, stop, rows) for name in "xytp")
    return to_events(where, x, y, times_us(where, t, unit_s), p, 1e-6)


def _times_at(
    columns: Mapping[str, str], unit_s: float, file: h5py.File, where: str, _stream: str,
    start: int, stop: int,
) -> NDArray[np.int64]:  # fmt: skip
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
    return _numbers(
        where, np.ascontiguousarray(rows[name][key if fields else (slice(None), int(key))])
    )


def _numbers(where: str, values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype.kind not in "iufb" or values.dtype.itemsize > 8 or values.ndim != 1:
        raise InputError(
            f"{where}: {shown(values.dtype)}; needs a column of plain numbers, damaged"
        )
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
            "seconds >= 0, polarity 1 or -1: the file is damaged, or its columns are assigned "
            "wrongly"
        )
    return events


def _matrix_times(
    file: h5py.File, where: str, stream: str, start: int, stop: int
) -> NDArray[np.int64]:
    # A chunk holds whole rows: reading only the times would cost the same.
    return _matrix(file, where, stream, start, stop).t_us
