"""Events as NumPy arrays, in an npz archive or an npy file; nothing is ever unpickled.

Columns are members of the archive, fields of one array, or columns of an (N, 4) one, in C or
Fortran order; `emvs.formats.tables.columns` says which is what. They are read as streams: memory
holds a block, compressed or not. Written are `x`, `y`, `t_us`, `p`, `width_px` and `height_px`.
"""

from __future__ import annotations

import io
import shutil
import struct
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import DAMAGED_NPY, InputError, quoted, refused, said, shown
from eventsweep.emvs.formats.base import StreamWriter
from eventsweep.emvs.formats.blocks import BlockReader, Numbers, to_events
from eventsweep.emvs.formats.prophesee import STREAM, opened
from eventsweep.emvs.formats.tables.columns import (
    CURE,
    ColumnMap,
    address_of,
    by_names,
    nameless_unit_s,
    order_of,
)

_ROWS = 1 << 18
_SAMPLE_ROWS = 1 << 12
_MOST_HEADER = 1 << 14
_FAULTS: tuple[type[Exception], ...] = (*DAMAGED_NPY, TypeError, RecursionError)
_MOST_ROW = 1 << 10
_SIZES = ("width_px", "height_px")
_COLUMNS: dict[str, type[np.generic]] = {
    "x": np.uint16,
    "y": np.uint16,
    "t_us": np.int64,
    "p": np.uint8,
}


@dataclass(frozen=True, slots=True)
class Array:
    """An array as its header declares it.

    Columns lie one after another `by_columns` (Fortran order), not rows; `head` bytes are in front
    of the values, which lie at a byte of the file, or nowhere (None) where they are compressed.
    """

    name: str
    shape: tuple[int, ...]
    kind: np.dtype[Any]
    by_columns: bool
    head: int
    place: int | None


@dataclass(frozen=True, slots=True)
class Run:
    """Rows of one type that lie behind each other: a column, or several side by side.

    `head` and `place` as of `Array`, for the first row.
    """

    name: str
    row: np.dtype[Any]
    head: int
    place: int | None


class NpzReader(BlockReader):
    """An archive of columns, as stated, or as names or values say: one stream, `events`."""

    format = "npz"

    def __init__(self, path: Path, columns: ColumnMap | None = None) -> None:
        super().__init__(Path(path), (STREAM,))
        arrays = self._arrays()
        self._runs: list[Run] = []
        self._count = 0
        self._of: dict[str, tuple[int, str]] = {}
        self._unit_s: float | None = None
        self._lay_out(arrays, columns)

    def scan(self, _stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads all columns side by side, and so checks the archive's sums."""
        with self._opened_at(0, whole=True) as files:
            for start in range(0, self._count, _ROWS):
                stop = min(start + _ROWS, self._count)
                yield (start, stop), self._events(files, start, stop)

    def load(self, _stream: str, place: Any) -> Events:
        """Reads one block: straight from the file where it is not compressed."""
        with self._opened_at(place[0]) as files:
            return self._events(files, *place)

    def share_before(self, _stream: str, place: Any) -> float:
        """Which share of the rows ends with a block."""
        return float(place[1] / max(1, self._count))

    def _arrays(self) -> dict[str, Array]:
        """What the archive holds; only headers are read."""
        with _archive(self.path) as archive:
            names = [name for name in archive.namelist() if name.endswith(".npy")]
            self.width_px, self.height_px = (
                _scalar(self.path, archive, name) if f"{name}.npy" in names else None
                for name in _SIZES
            )
            found = [_array_of(self.path, archive, name) for name in names]
        return {array.name: array for array in found if array.name not in _SIZES}

    def _lay_out(self, arrays: Mapping[str, Array], columns: ColumnMap | None) -> None:
        """Finds each column's run, and how many rows there are."""
        addresses, unit_s = self._chosen(arrays, columns)
        counts = {}
        for name, address in addresses.items():
            array, run, field = _run_of(self.path, arrays, address)
            counts[address] = array.shape[0]
            if run not in self._runs:
                self._runs.append(run)
            self._of[name] = self._runs.index(run), field
        if len(set(counts.values())) != 1:
            raise InputError(
                f"{self.path}: columns of different lengths {counts}; needs equal lengths"
            )
        self._count = next(iter(counts.values()))
        self._unit_s = unit_s if columns is None or columns.unit_s is None else columns.unit_s
        if addresses["p"].endswith("[3]") and not (columns and columns.x):
            self._find_order()

    def _chosen(
        self, arrays: Mapping[str, Array], columns: ColumnMap | None
    ) -> tuple[dict[str, str], float | None]:
        if columns is not None and columns.x:
            return columns.addresses, columns.unit_s
        (array, *others) = arrays.values() if arrays else (None,)
        if array is None or others:
            named, unit_s = by_names(str(self.path), arrays)
            return named.addresses, unit_s
        if array.kind.names:
            named, unit_s = by_names(str(self.path), array.kind.names)
            return {name: f"{array.name}[{key}]" for name, key in named.addresses.items()}, unit_s
        if len(array.shape) != 2 or array.shape[1] != 4:
            raise InputError(
                f"{self.path}: one array of shape {array.shape}; needs (N, 4), or {CURE}"
            )
        return {name: f"{array.name}[{k}]" for k, name in enumerate("xytp")}, None

    def _find_order(self) -> None:
        """Tells the order and the unit of four nameless columns from their last rows."""
        start = max(0, self._count - _SAMPLE_ROWS)
        with self._opened_at(start) as files:
            rows = self._values(files, start, self._count)
        order = order_of(str(self.path), [rows[name] for name in "xytp"])
        self._of = {name: self._of["xytp"[k]] for k, name in enumerate(order)}
        if self._unit_s is None:
            self._unit_s = nameless_unit_s(str(self.path), rows["xytp"[order.index("t")]])

    @contextmanager
    def _opened_at(self, row: int, *, whole: bool = False) -> Iterator[list[IO[bytes]]]:
        """Each run at a row; through the archive where it is compressed or read `whole`."""
        with ExitStack() as stack:
            yield [
                stack.enter_context(self._run_at(run, row * run.row.itemsize, whole=whole))
                for run in self._runs
            ]

    @contextmanager
    def _run_at(self, run: Run, at: int, *, whole: bool) -> Iterator[IO[bytes]]:
        """A run at a byte of it."""
        if run.place is not None and not (self.format == "npz" and whole):
            with opened(self.path) as file:
                file.seek(run.place + at)
                yield file
            return
        with _archive(self.path) as archive, archive.open(f"{run.name}.npy") as member:
            member.seek(run.head + at)
            yield member

    def _values(self, files: list[IO[bytes]], start: int, stop: int) -> dict[str, Numbers]:
        """The four columns of the rows that come next in the files."""
        rows = []
        for run, file in zip(self._runs, files, strict=True):
            size = (stop - start) * run.row.itemsize
            data = file.read(size)
            if len(data) != size:
                raise InputError(
                    f"{_where(self.path, run.name)}: ends before row {stop} of {self._count}; "
                    "the file is damaged, download it again"
                )
            rows.append(np.frombuffer(data, run.row))
        picked = {name: (rows[k], field) for name, (k, field) in self._of.items()}
        return {
            name: np.ascontiguousarray(values[field]) if field else values
            for name, (values, field) in picked.items()
        }

    def _events(self, files: list[IO[bytes]], start: int, stop: int) -> Events:
        values = self._values(files, start, stop)
        where = f"{self.path}, rows {start} to {stop}"
        x, y, t, p = (values[name] for name in "xytp")
        return to_events(where, x, y, t, p, self._unit_s)


def member(path: Path, name: str, most_bytes: int) -> tuple[Array, bytes]:
    """One array of an archive as its header declares it, and the bytes of its values.

    Raises:
        InputError: no such array, one of more than `most_bytes`, or damage.
    """
    with _archive(path) as archive:
        if f"{name}.npy" not in archive.namelist():
            raise InputError(f"{path}: lacks the array {quoted(name)}; download it again")
        info = archive.getinfo(f"{name}.npy")
        if info.file_size > most_bytes:
            raise InputError(
                f"{_where(path, name)}: {info.file_size} bytes, at most {most_bytes} are read"
            )
        with archive.open(info) as file:
            shape, by_columns, kind = _header(path, name, file)
            array = Array(name, shape, kind, by_columns, file.tell(), None)
            data = file.read()
    if not kind.hasobject:
        check_size(path, array, len(data))
    return array, data


def member_names(path: Path) -> list[str]:
    """Names of the arrays of an archive."""
    with _archive(path) as archive:
        return [n.removesuffix(".npy") for n in archive.namelist() if n.endswith(".npy")]


class NpyReader(NpzReader):
    """One array in a file: (N, 4), or with fields; one stream, `events`."""

    format = "npy"

    def _arrays(self) -> dict[str, Array]:
        with opened(self.path) as file:
            shape, by_columns, kind = _header(self.path, "", file)
            head = file.tell()
        array = Array("", shape, kind, by_columns, head, head)
        check_size(self.path, array, self.path.stat().st_size - head)
        return {"": array}


FOLDER_FILES = {name: f"dataset_events_{name}.npy" for name in ("t", "xy", "p")}
"""Files of a folder of EVIMO2 with events: times in s, (N, 2) pixels, polarity."""


class NpyFolderReader(NpzReader):
    """EVIMO2's folder with an npy file of times, one of pixels and one of polarities."""

    format = "evimo2"

    def _arrays(self) -> dict[str, Array]:
        return {name: self._array(name, self.path / file) for name, file in FOLDER_FILES.items()}

    def _array(self, name: str, path: Path) -> Array:
        with opened(path) as file:
            shape, by_columns, kind = _header(path, "", file)
            head = file.tell()
        check_size(path, Array("", shape, kind, by_columns, head, head), path.stat().st_size - head)
        flat = shape[:1] if name != "xy" and shape[1:] == (1,) else shape
        return Array(name, flat, kind, by_columns, head, head)

    def _chosen(
        self, arrays: Mapping[str, Array], columns: ColumnMap | None
    ) -> tuple[dict[str, str], float | None]:
        del arrays, columns
        return {"x": "xy[0]", "y": "xy[1]", "t": "t", "p": "p"}, None

    @contextmanager
    def _run_at(self, run: Run, at: int, *, whole: bool) -> Iterator[IO[bytes]]:
        del whole
        with opened(self.path / FOLDER_FILES[run.name]) as file:
            file.seek((run.place or 0) + at)
            yield file


def _run_of(path: Path, arrays: Mapping[str, Array], address: str) -> tuple[Array, Run, str]:
    """The array that an address names, its run of rows, and which field of them is meant."""
    name, key = address_of(address)
    if name not in arrays and not key and "" in arrays:
        name, key = "", address  # the columns of an npy file
    if name not in arrays:
        raise InputError(f"{path}: no column {quoted(name)}; choose from {quoted(*sorted(arrays))}")
    array, where = arrays[name], _where(path, name)
    fields = array.kind.names
    if array.kind.hasobject:
        raise InputError(
            f"{where}: of type {shown(array.kind)}; needs plain numbers of up to 8 bytes"
        )
    if fields:
        if key not in fields or len(array.shape) != 1:
            raise InputError(f"{where}: fields {quoted(*fields)}, not {quoted(key)}; {CURE}")
        _check_number(where, array.kind[key])
        return array, Run(name, array.kind, array.head, array.place), key
    _check_number(where, array.kind)
    if not key:
        if len(array.shape) != 1:
            raise InputError(f"{where}: shape {array.shape}; needs (N,), or a number in brackets")
        return array, Run(name, array.kind, array.head, array.place), ""
    width = array.shape[1] if len(array.shape) == 2 else 0
    if not key.isdecimal() or int(key) >= width or width * array.kind.itemsize > _MOST_ROW:
        raise InputError(f"{where}: no column {quoted(key)} in an array of shape {array.shape}")
    if array.by_columns:
        skip = int(key) * array.shape[0] * array.kind.itemsize
        place = None if array.place is None else array.place + skip
        return array, Run(name, array.kind, array.head + skip, place), ""
    row = np.dtype([(str(k), array.kind) for k in range(width)])
    return array, Run(name, row, array.head, array.place), key


def _where(path: Path, name: str) -> str:
    return f"{path}, column {name}" if name else str(path)


def _check_number(where: str, kind: np.dtype[Any]) -> None:
    if kind.kind not in "iufb" or kind.itemsize > 8:
        raise InputError(f"{where}: of type {kind}; needs plain numbers of up to 8 bytes")


def _array_of(path: Path, archive: zipfile.ZipFile, member_name: str) -> Array:
    """Looks an array up; refuses a count that the archive contradicts."""
    name, info = member_name.removesuffix(".npy"), archive.getinfo(member_name)
    with archive.open(info) as member:
        shape, by_columns, kind = _header(path, name, member)
        head = member.tell()
    place = None
    if info.compress_type == zipfile.ZIP_STORED:
        place = _content_at(path, info.header_offset) + head
    array = Array(name, shape, kind, by_columns, head, place)
    if not kind.hasobject:  # refused where it is asked for
        check_size(path, array, info.file_size - head)
    return array


def check_size(path: Path, array: Array, size: int) -> None:
    """Refuses an array whose bytes are not all there, or with more of them."""
    where = _where(path, array.name)
    if array.kind.hasobject:
        raise InputError(f"{where}: of type {shown(array.kind)}; needs plain numbers")
    needed = int(np.prod([1, *array.shape], dtype=object)) * array.kind.itemsize
    if size != needed or min(array.shape, default=0) < 0:
        raise InputError(
            f"{where}: shape {shown(array.shape)} of {array.kind.itemsize} bytes declared, "
            f"{size} bytes present; the file is damaged, download it again"
        )
    if array.kind.itemsize > _MOST_ROW:
        raise InputError(
            f"{where}: rows of {array.kind.itemsize} bytes, at most {_MOST_ROW} are read"
        )


def _content_at(path: Path, header_at: int) -> int:
    """Where a member's bytes begin: behind 30 bytes, a name and a field of any length."""
    with opened(path) as file:
        file.seek(header_at + 26)
        name, extra = struct.unpack("<HH", file.read(4))
        return int(header_at + 30 + name + extra)


@contextmanager
def _archive(path: Path) -> Iterator[zipfile.ZipFile]:
    # Of zipfile, of four decompressors, and of damaged names comes any exception.
    with (
        refused(f"{path}: not a complete npz archive", Exception, cure="; save it again"),
        zipfile.ZipFile(path) as archive,
    ):
        yield archive


def _header(
    path: Path, name: str, member: IO[bytes]
) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, order and type; leaves the member where its values begin."""
    try:
        version = np.lib.format.read_magic(member)
        size = member.read(2 if version == (1, 0) else 4)
        length = int.from_bytes(size, "little")
        if length > _MOST_HEADER:
            raise ValueError(f"it declares {length} bytes")
        read = (
            np.lib.format.read_array_header_1_0
            if version == (1, 0)
            else np.lib.format.read_array_header_2_0
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python 2's headers, and damage that looks like them
            return read(io.BytesIO(size + member.read(length)))
    except _FAULTS as error:
        raise InputError(
            f"{_where(path, name)}: no npy header ({said(error)}); save the file again"
        ) from error


def _scalar(path: Path, archive: zipfile.ZipFile, name: str) -> int:
    with archive.open(f"{name}.npy") as member:
        shape, _, kind = _header(path, name, member)
        _check_number(f"{path}, {name}", kind)
        data = member.read(kind.itemsize)
    value: NDArray[Any] = np.frombuffer(data, kind)
    if shape not in ((), (1,)) or len(value) != 1 or not 0 < value[0] <= 1 << 16:
        raise InputError(f"{path}, {name}: needs one whole number, 1 to 65536")
    return int(value[0])


class NpzWriter(StreamWriter):
    """Appends to one plain file per column; the archive is put together at the end."""

    packet = 1 << 20
    kinds: Mapping[str, type[np.generic]] = _COLUMNS

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._path, self._size_px = path, {"width_px": width_px, "height_px": height_px}
        self._count = 0
        self._parts = {name: path.with_name(f"{path.name}.{name}") for name in self.kinds}
        self._files = {name: part.open("wb") for name, part in self._parts.items()}

    def _put(self, _stream: str, events: Events) -> None:
        self._count += len(events)
        for name, kind in self.kinds.items():
            self._files[name].write(np.ascontiguousarray(self._column(events, name), kind).data)

    @staticmethod
    def _column(events: Events, name: str) -> NDArray[Any]:
        return np.asarray(getattr(events, name))

    def _finish(self) -> None:
        for file in self._files.values():
            file.flush()
        with zipfile.ZipFile(self._path, "w", zipfile.ZIP_STORED) as archive:
            for name, kind in self.kinds.items():
                member = zipfile.ZipInfo(f"{name}.npy")
                with (
                    archive.open(member, "w", force_zip64=True) as out,
                    self._parts[name].open("rb") as part,
                ):
                    _write_header(out, kind, (self._count,))
                    shutil.copyfileobj(part, out, 1 << 20)
            for name, value in self._size_px.items():
                with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as out:
                    _write_header(out, np.int64, ())
                    out.write(np.int64(value).tobytes())

    def _close(self) -> None:
        for file in self._files.values():
            file.close()
        for part in self._parts.values():
            part.unlink(missing_ok=True)


class SignedNpzWriter(NpzWriter):
    """Times are `t`, µs, and polarity is -1 or 1, as EventNeRF takes them."""

    kinds: Mapping[str, type[np.generic]] = {
        "x": np.uint16, "y": np.uint16, "t": np.int64, "p": np.int8
    }  # fmt: skip

    @staticmethod
    def _column(events: Events, name: str) -> NDArray[Any]:
        if name == "p":
            return 2 * events.p.astype(np.int8) - 1
        return np.asarray(events.t_us if name == "t" else getattr(events, name))


def _write_header(out: IO[bytes], kind: type[np.generic], shape: tuple[int, ...]) -> None:
    descr = np.lib.format.dtype_to_descr(np.dtype(kind))
    header = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(out, header)
