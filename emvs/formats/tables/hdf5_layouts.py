"""Which data sets of an HDF5 file hold events, and what their columns and times are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.event_columns import ColumnReader, EventColumns
from eventsweep.emvs.data.event_store import STORE
from eventsweep.emvs.data.events import Events, Numbers
from eventsweep.emvs.data.hdf5 import check_dataset, open_hdf5
from eventsweep.emvs.errors import InputError, quoted, shown
from eventsweep.emvs.formats.prophesee import STREAM
from eventsweep.emvs.formats.tables.columns import (
    CURE,
    ColumnMap,
    address_of,
    nameless_unit_s,
    order_of,
)
from eventsweep.emvs.formats.tables.hdf5_kernels import convert_rows

_DAVIS = ("davis/left/events", "davis/right/events")
_CD = "CD/events"
_PROPHESEE = ("prophesee/left", "prophesee/right")
_EVENTS = {name: f"events/{name}" for name in "xytp"}
_ORDERS_AS_STATED = ("e2calib", "v2e", "hdf5")
_SAMPLE_ROWS = 1 << 12


class Hdf5Layout(NamedTuple):
    """One layout: its name, the columns of each stream, width and height where the file says."""

    format: str
    streams: dict[str, EventColumns]
    size_px: tuple[int, int] | None = None


def hdf5_layout(path: Path, columns: ColumnMap | None = None) -> Hdf5Layout:
    """Recognises the layout of a file by its data sets, or takes it as stated."""
    with open_hdf5(path) as file:
        if columns is not None and columns.x:
            return _stated(path, file, columns)
        layout = _known(path, file, columns.unit_s if columns is not None else None)
    if columns is not None and layout.format not in _ORDERS_AS_STATED:
        raise InputError(
            f"{path}: is {layout.format}, which defines its time unit; leave `time_unit` out"
        )
    return layout


def _stated(path: Path, file: h5py.File, columns: ColumnMap) -> Hdf5Layout:
    layout = _one_stream("hdf5", columns.addresses, columns.unit_s or 1e-6)
    names = layout.streams[STREAM].axes
    missing = [name for name in names if not isinstance(file.get(name), h5py.Dataset)]
    if missing:
        there: list[str] = []
        file.visit(there.append)
        raise InputError(f"{path}: no data set {quoted(*missing)}; holds {quoted(*sorted(there))}")
    return layout


def _known(path: Path, file: h5py.File, unit_s: float | None) -> Hdf5Layout:
    if _CD in file:
        fields = {name: f"{_CD}[{name}]" for name in "xytp"}
        return _one_stream("prophesee-hdf5", fields)._replace(size_px=_size(file))
    davis = [name for name in _DAVIS if name in file]
    if davis:
        places = {name: {c: f"{name}[{k}]" for k, c in enumerate("xytp")} for name in davis}
        streams = {name.removesuffix("/events"): _columns(p, 1.0) for name, p in places.items()}
        return Hdf5Layout("mvsec", streams)
    if any(name in file for name in _PROPHESEE):
        return _in_groups(path, file)
    if isinstance(file.get("events"), h5py.Dataset):
        return _nameless(path, file, unit_s)
    there = [name for name in _EVENTS.values() if name in file]
    if len(there) == len(_EVENTS):
        if "t_offset" in file:
            return Hdf5Layout("dsec", {STREAM: replace(STORE, least_us=0)})
        return Hdf5Layout("tumvie", {STREAM: _columns(_EVENTS, index="ms_to_idx")})
    if there:
        missing = ", ".join(sorted(set(_EVENTS.values()) - set(there)))
        raise InputError(f"{path}: lacks {missing}; needs all of {', '.join(_EVENTS.values())}")
    if all(isinstance(file.get(name), h5py.Dataset) for name in "xytp"):
        if file["t"].dtype.kind not in "iu" and unit_s is None:
            raise InputError(f"{path}: t of type {file['t'].dtype}; set `time_unit`")
        return _one_stream("e2calib", {name: name for name in "xytp"}, unit_s or 1e-6)
    raise InputError(
        f"{path}: holds {quoted(*sorted(file)) or 'nothing'}; needs events/x, y, t, p (DSEC, "
        f"TUM-VIE), {' or '.join(_DAVIS)} (MVSEC), {' or '.join(_PROPHESEE)} (M3ED), {_CD} "
        f"(Prophesee), events of (N, 4) (v2e), or x, y, t, p (e2calib); or {CURE}"
    )


def _columns(addresses: Mapping[str, str], unit_s: float = 1e-6, index: str = "") -> EventColumns:
    return EventColumns({name: address_of(a) for name, a in addresses.items()}, unit_s, index)


def _one_stream(kind: str, addresses: Mapping[str, str], unit_s: float = 1e-6) -> Hdf5Layout:
    return Hdf5Layout(kind, {STREAM: _columns(addresses, unit_s)})


def _in_groups(path: Path, file: h5py.File) -> Hdf5Layout:
    """M3ED's: the columns of each camera in a group of its own."""
    streams = {}
    for group in (name for name in _PROPHESEE if name in file):
        names = {name: f"{group}/{name}" for name in "xytp"}
        missing = [name for name in names.values() if name not in file]
        if missing:
            raise InputError(f"{path}: lacks {', '.join(missing)}; download it again")
        columns = _columns(names, index=f"{group}/ms_map_idx")
        streams[group] = replace(columns, lacks_last=True)
    return Hdf5Layout("m3ed", streams)


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
    addresses = {name: f"events[{order.index(name)}]" for name in "xytp"}
    return _one_stream(kind, addresses, unit_s or 1e-6)


def _size(file: h5py.File) -> tuple[int, int] | None:
    words = str(file.attrs.get("geometry", "")).split("x")
    if len(words) == 2 and all(word.isdigit() for word in words):
        return int(words[0]), int(words[1])
    return None


class MatrixReader(ColumnReader):
    """Reads MVSEC's rows of doubles, which one pass converts."""

    def events_of(self, file: h5py.File, start: int, stop: int) -> Events:
        """Events of rows of the open file."""
        data = file[self._columns.addresses["x"][0]]
        if data.shape[1] != 4:
            where = self._where(start, stop)
            raise InputError(f"{where}: shape {data.shape}, needs (N, 4): x, y, t in seconds, p")
        rows = np.ascontiguousarray(data[start:stop], np.float64)
        events = Events.room(len(rows))
        bad = convert_rows(rows, events.columns)
        if bad >= 0:
            raise InputError(
                f"{self._where(start, stop)}: row {start + bad} is {rows[bad].tolist()}; needs "
                "whole pixels 0 to 65535, seconds >= 0, polarity 1 or -1: the file is damaged, or "
                "its columns are assigned wrongly"
            )
        return events

    def times_of(
        self, file: h5py.File, start: int, stop: int, _kept: dict[str, Numbers] | None = None
    ) -> NDArray[np.int64]:
        """Times of rows, µs; a chunk holds whole rows, so that times alone cost as much."""
        return self.events_of(file, start, stop).t_us
