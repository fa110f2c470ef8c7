"""How publishers lay events out in HDF5: which data sets, which unit, which streams."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events
from emvs.data.hdf5 import check_dataset, open_hdf5
from emvs.errors import InputError
from emvs.io.events.convert_columns import times_us, to_events
from emvs.io.events.matrix_kernel import convert_rows
from emvs.io.events.wording import quoted, said

Streams = dict[str, tuple[str, ...]]
_DAVIS = ("davis/left/events", "davis/right/events")
_CD = "CD/events"


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
    """

    format: str
    streams: dict[str, tuple[str, ...]]
    events: Callable[[h5py.File, str, str, int, int], Events]
    times: Callable[[h5py.File, str, str, int, int], NDArray[np.int64]]
    size_px: tuple[int, int] | None = None


def hdf5_layout(path: Path) -> Hdf5Layout:
    """Recognises the layout of a file by its data sets.

    Raises:
        InputError: a damaged file, or one without events in a known place.
    """
    with opened_hdf5(path) as file:
        if _CD in file:
            return Hdf5Layout("prophesee-hdf5", {"events": (_CD,)}, _cd, _cd_times, _size(file))
        davis: Streams = {name.removesuffix("/events"): (name,) for name in _DAVIS if name in file}
        if davis:
            return Hdf5Layout("mvsec", davis, _matrix, _matrix_times)
        columns = tuple(f"events/{name}" for name in "xytp")
        there = [name for name in columns if name in file]
        if len(there) == len(columns):
            kind = "dsec" if "t_offset" in file else "tumvie"
            return Hdf5Layout(kind, {"events": columns}, _columns, _column_times)
        found = quoted(*sorted(file)) or "nothing"
    if there:
        missing = ", ".join(sorted(set(columns) - set(there)))
        raise InputError(f"{path}: lacks {missing}; needs all of {', '.join(columns)}")
    raise InputError(
        f"{path}: holds {found}; needs events/x, y, t, p (DSEC, TUM-VIE), {' or '.join(_DAVIS)} "
        f"(MVSEC) or {_CD} (Prophesee)"
    )


def check_columns(
    path: Path, file: h5py.File, names: tuple[str, ...], axes: int | None = None
) -> int:
    """Rows of a stream; refuses data sets that do not match or whose bytes are not all there.

    Args:
        path: the file, for the error's sake.
        file: open.
        names: data sets that must be as long as each other.
        axes: how many each must have; by default what the layouts of events say.

    Raises:
        InputError: as said, or a filter that is not installed.
    """
    counts = {name: check_dataset(path, file[name]) for name in names}
    for name in names:
        if file[name].ndim != (axes or (2 if name in _DAVIS else 1)):
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


def _columns(file: h5py.File, where: str, stream: str, start: int, stop: int) -> Events:
    x, y, p = (file[f"{stream}/{name}"][start:stop] for name in "xyp")
    return to_events(where, x, y, _column_times(file, where, stream, start, stop), p, 1e-6)


def _column_times(
    file: h5py.File, where: str, stream: str, start: int, stop: int
) -> NDArray[np.int64]:
    return times_us(where, file[f"{stream}/t"][start:stop], 1e-6) + offset_us(file)


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


def _cd(file: h5py.File, where: str, stream: str, start: int, stop: int) -> Events:
    del stream
    data = file[_CD]
    if data.dtype.names is None or not {"x", "y", "t", "p"} <= set(data.dtype.names):
        raise InputError(f"{where}: fields {quoted(*(data.dtype.names or ()))}; needs x, y, p, t")
    rows = data[start:stop]
    x, y, t, p = (np.ascontiguousarray(rows[name]) for name in "xytp")
    return to_events(where, x, y, t, p, 1e-6)


def _cd_times(file: h5py.File, where: str, stream: str, start: int, stop: int) -> NDArray[np.int64]:
    return _cd(file, where, stream, start, stop).t_us
