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
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, ClassVar, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events, Numbers, to_events
from eventsweep.emvs.errors import DAMAGED_NPY, InputError, offer, quoted, refused, said, shown
from eventsweep.emvs.formats.base import StreamWriter
from eventsweep.emvs.formats.blocks import BlockReader
from eventsweep.emvs.formats.prophesee import STREAM, opened
from eventsweep.emvs.formats.tables.columns import (
    CURE,
    ColumnMap,
    address_of,
    agreed_unit_s,
    by_names,
    nameless_unit_s,
    order_of,
)

_ROWS = 1 << 18
_SAMPLE_ROWS = 1 << 12
_MOST_HEADER = 1 << 14
_MOST_ROW = 1 << 10
_FAULTS: tuple[type[Exception], ...] = (*DAMAGED_NPY, TypeError, RecursionError)
_SIZES = ("width_px", "height_px")


@dataclass(frozen=True, slots=True)
class Array:
    """An array as its header declares it.

    Columns lie one after another `by_columns` (Fortran order), not rows; `head` bytes are in front
    of the values, which lie at a byte of the file, or nowhere (None) where they are compressed.
    """

    name: str
    shape: tuple[int, ...]
    by_columns: bool
    kind: np.dtype[Any]
    head: int
    place: int | None = None


class _Run(NamedTuple):
    """Rows of one type that follow each other, `skip` bytes into an array's values.

    They are a column, or several side by side.
    """

    array: Array
    skip: int
    row: np.dtype[Any]


_Files = list[IO[bytes]]
_Written = tuple[type[np.generic], Callable[[Events], NDArray[Any]]]


class ArrayReader(BlockReader):
    """Columns in arrays, as stated, or as names or values say: one stream, `events`."""

    def __init__(self, path: Path, columns: ColumnMap | None = None) -> None:
        super().__init__(Path(path), (STREAM,))
        arrays = self._declared()
        is_stated = columns is not None and bool(columns.x)
        addresses, unit_s = (
            (columns.addresses, None) if columns and is_stated else self._chosen(arrays)
        )
        self._unit_s = agreed_unit_s(str(self.path), unit_s, columns)
        self._runs: list[_Run] = []
        self._columns: dict[str, tuple[int, Any]] = {}
        rows: dict[str, int] = {}
        for what, address in addresses.items():
            run, pick = _run_of(self.path, arrays, address)
            self._runs += [] if run in self._runs else [run]
            self._columns[what] = self._runs.index(run), pick
            rows[address] = run.array.shape[0]
        if len(set(rows.values())) != 1:
            raise InputError(
                f"{self.path}: columns of different lengths {rows}; needs equal lengths"
            )
        self._count = next(iter(rows.values()))
        if addresses["p"].endswith("[3]") and not is_stated:
            self._find_order()

    def _declared(self) -> dict[str, Array]:
        """What the file holds; only headers are read."""
        raise NotImplementedError

    def _opened(self, array: Array, at: int, *, whole: bool) -> AbstractContextManager[IO[bytes]]:
        """The values of an array from a byte on; `whole` where all of them will be read."""
        raise NotImplementedError

    def scan(self, _stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads all columns side by side, and so checks an archive's sums."""
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

    def _chosen(self, arrays: Mapping[str, Array]) -> tuple[dict[str, str], float | None]:
        """The addresses of x, y, t and p, and what times count, s, if names say it."""
        if len(arrays) != 1:
            return by_names(str(self.path), arrays)
        (array,) = arrays.values()
        if array.kind.names:
            named, unit_s = by_names(str(self.path), array.kind.names)
            return {name: f"{array.name}[{key}]" for name, key in named.items()}, unit_s
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
        order = order_of(str(self.path), list(rows.values()))
        self._columns = {what: self._columns["xytp"[k]] for k, what in enumerate(order)}
        if self._unit_s is None:
            self._unit_s = nameless_unit_s(str(self.path), rows["xytp"[order.index("t")]])

    @contextmanager
    def _opened_at(self, row: int, *, whole: bool = False) -> Iterator[_Files]:
        """Each run at a row."""
        with ExitStack() as stack:
            starts = [(run.array, run.skip + row * run.row.itemsize) for run in self._runs]
            yield [stack.enter_context(self._opened(*start, whole=whole)) for start in starts]

    def _values(self, files: _Files, start: int, stop: int) -> dict[str, Numbers]:
        """The four columns of the rows that come next in the files."""
        rows = []
        for run, file in zip(self._runs, files, strict=True):
            size = (stop - start) * run.row.itemsize
            data = file.read(size)
            if len(data) != size:
                raise InputError(
                    f"{_where(self.path, run.array.name)}: ends before row {stop} of "
                    f"{self._count}; the file is damaged, download it again"
                )
            rows.append(np.frombuffer(data, run.row))
        columns = self._columns.items()
        return {what: np.ascontiguousarray(rows[k][pick]) for what, (k, pick) in columns}

    def _events(self, files: _Files, start: int, stop: int) -> Events:
        values = self._values(files, start, stop)
        where = f"{self.path}, rows {start} to {stop}"
        return to_events(where, **values, unit_s=self._unit_s)


class NpyReader(ArrayReader):
    """One array in a file: (N, 4), or with fields; one stream, `events`."""

    format = "npy"

    def _file(self, name: str) -> Path:
        """The file of an array."""
        del name
        return self.path

    def _declared(self) -> dict[str, Array]:
        return {"": self._read_head("")}

    def _read_head(self, name: str) -> Array:
        path = self._file(name)
        with opened(path) as file:
            array = _header(path, name, file)
        check_size(path, replace(array, name=""), path.stat().st_size - array.head)
        return array

    @contextmanager
    def _opened(self, array: Array, at: int, *, whole: bool) -> Iterator[IO[bytes]]:
        del whole
        with opened(self._file(array.name)) as file:
            file.seek(array.head + at)
            yield file


FOLDER_FILES = {name: f"dataset_events_{name}.npy" for name in ("t", "xy", "p")}
"""Files of a folder of EVIMO2 with events: times in s, (N, 2) pixels, polarity."""


class NpyFolderReader(NpyReader):
    """EVIMO2's folder with an npy file of times, one of pixels and one of polarities."""

    format = "evimo2"

    def _file(self, name: str) -> Path:
        return self.path / FOLDER_FILES[name]

    def _declared(self) -> dict[str, Array]:
        arrays = {name: self._read_head(name) for name in FOLDER_FILES}
        flat = [n for n, a in arrays.items() if n != "xy" and a.shape[1:] == (1,)]
        return arrays | {n: replace(arrays[n], shape=arrays[n].shape[:1]) for n in flat}

    def _chosen(self, arrays: Mapping[str, Array]) -> tuple[dict[str, str], float | None]:
        del arrays
        return {"x": "xy[0]", "y": "xy[1]", "t": "t", "p": "p"}, None


class NpzReader(ArrayReader):
    """An archive of columns."""

    format = "npz"

    def _declared(self) -> dict[str, Array]:
        arrays: dict[str, Array] = {}
        with opened_archive(self.path) as archive:
            for info in archive.infolist():
                if info.filename.endswith(".npy"):
                    array = _member_array(self.path, archive, info)
                    arrays[array.name] = array
            self.width_px, self.height_px = (
                _scalar(self.path, archive, arrays.pop(name)) if name in arrays else None
                for name in _SIZES
            )
        return arrays

    @contextmanager
    def _opened(self, array: Array, at: int, *, whole: bool) -> Iterator[IO[bytes]]:
        if array.place is not None and not whole:
            with opened(self.path) as file:
                file.seek(array.place + at)
                yield file
            return
        with opened_archive(self.path) as archive, archive.open(f"{array.name}.npy") as member:
            member.seek(array.head + at)
            yield member


@contextmanager
def opened_archive(path: Path) -> Iterator[zipfile.ZipFile]:
    """The members of an npz; damage becomes one line."""
    # Of zipfile, of four decompressors, and of damaged names comes any exception.
    with (
        refused(f"{path}: not a complete npz archive", Exception, cure="; save it again"),
        opened(path) as file,
        zipfile.ZipFile(file) as archive,
    ):
        yield archive


def _member_array(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Array:
    with archive.open(info) as member:
        array = _header(path, info.filename.removesuffix(".npy"), member)
    if not array.kind.hasobject:  # which is refused where it is asked for
        check_size(path, array, info.file_size - array.head)
    if info.compress_type != zipfile.ZIP_STORED:
        return array
    with opened(path) as file:  # a member is behind 30 bytes, a name and a field of any length
        file.seek(info.header_offset + 26)
        lengths = struct.unpack("<HH", file.read(4))
    return replace(array, place=info.header_offset + 30 + sum(lengths) + array.head)


def _scalar(path: Path, archive: zipfile.ZipFile, array: Array) -> int:
    """A whole number that is a member."""
    _check_number(f"{path}, {array.name}", array.kind)
    data = archive.read(f"{array.name}.npy")[array.head :] if array.shape in ((), (1,)) else b""
    value: NDArray[Any] = np.frombuffer(data, array.kind)
    if len(value) != 1 or not 0 < value[0] <= 1 << 16:
        raise InputError(f"{path}, {array.name}: needs one whole number, 1 to 65536")
    return int(value[0])


def member(path: Path, name: str, most_bytes: int) -> tuple[Array, bytes]:
    """One array of an archive as its header declares it, and the bytes of its values.

    Raises:
        InputError: no such array, one of more than `most_bytes`, or damage.
    """
    with opened_archive(path) as archive:
        if f"{name}.npy" not in archive.namelist():
            raise InputError(f"{path}: lacks the array {quoted(name)}; download it again")
        info = archive.getinfo(f"{name}.npy")
        if info.file_size > most_bytes:
            raise InputError(
                f"{_where(path, name)}: {info.file_size} bytes, at most {most_bytes} are read"
            )
        array = _member_array(path, archive, info)
        return array, archive.read(info)[array.head :]


def _header(path: Path, name: str, file: IO[bytes]) -> Array:
    """What the header of an array declares."""
    head = io.BytesIO(file.read(_MOST_HEADER))
    try:
        is_first = npy.read_magic(head) == (1, 0)
        read = npy.read_array_header_1_0 if is_first else npy.read_array_header_2_0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python 2's headers, and damage that looks like them
            return Array(name, *read(head), head.tell())
    except _FAULTS as error:
        raise InputError(
            f"{_where(path, name)}: no npy header ({said(error)}); save the file again"
        ) from error


def check_size(path: Path, array: Array, size: int) -> None:
    """Refuses an array whose bytes are not all there, or with more of them."""
    where, row_bytes = _where(path, array.name), array.kind.itemsize
    if array.kind.hasobject:
        raise InputError(f"{where}: of type {shown(array.kind)}; needs plain numbers")
    needed = int(np.prod([1, *array.shape], dtype=object)) * row_bytes
    if size != needed or min(array.shape, default=0) < 0:
        raise InputError(
            f"{where}: shape {shown(array.shape)} of {row_bytes} bytes declared, {size} bytes "
            "present; the file is damaged, download it again"
        )
    if row_bytes > _MOST_ROW:
        raise InputError(f"{where}: rows of {row_bytes} bytes, at most {_MOST_ROW} are read")


def _run_of(path: Path, arrays: Mapping[str, Array], address: str) -> tuple[_Run, Any]:
    """The rows that hold the column at an address, and which part of them it is."""
    name, key = address_of(address)
    if name not in arrays and not key and "" in arrays:
        name, key = "", address  # the columns of an npy file
    if name not in arrays:
        known = offer(sorted(arrays), "it holds no array")
        raise InputError(f"{path}: no column {quoted(name)}; {known}")
    array, where = arrays[name], _where(path, name)
    kind, shape = array.kind, array.shape
    if kind.names and not kind.hasobject:
        if key not in kind.names or len(shape) != 1:
            raise InputError(f"{where}: fields {quoted(*kind.names)}, not {quoted(key)}; {CURE}")
        _check_number(where, kind[key])
        return _Run(array, 0, kind), key
    _check_number(where, kind)
    if not key:
        if len(shape) != 1:
            raise InputError(f"{where}: shape {shape}; needs (N,), or a number in brackets")
        return _Run(array, 0, kind), ...
    rows, width = shape if len(shape) == 2 else (0, 0)
    if not key.isdecimal() or int(key) >= width or width * kind.itemsize > _MOST_ROW:
        raise InputError(f"{where}: no column {quoted(key)} in an array of shape {shape}")
    if array.by_columns:
        return _Run(array, int(key) * rows * kind.itemsize, kind), ...
    return _Run(array, 0, np.dtype((kind, (width,)))), (slice(None), int(key))


def _check_number(where: str, kind: np.dtype[Any]) -> None:
    if kind.kind not in "iufb" or kind.itemsize > 8:
        raise InputError(f"{where}: of type {kind}; needs plain numbers of up to 8 bytes")


def _where(path: Path, name: str) -> str:
    return f"{path}, column {name}" if name else str(path)


class NpzWriter(StreamWriter):
    """Appends to one plain file per column; the archive is put together at the end."""

    packet = 1 << 20
    columns: ClassVar[dict[str, _Written]] = {
        "x": (np.uint16, lambda events: events.x),
        "y": (np.uint16, lambda events: events.y),
        "t_us": (np.int64, lambda events: events.t_us),
        "p": (np.uint8, lambda events: events.p),
    }

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._path, self._size_px = path, {"width_px": width_px, "height_px": height_px}
        self._count = 0
        self._parts = {name: path.with_name(f"{path.name}.{name}") for name in self.columns}
        self._files = {name: part.open("wb") for name, part in self._parts.items()}

    def _put(self, _stream: str, events: Events) -> None:
        self._count += len(events)
        for name, (kind, column) in self.columns.items():
            self._files[name].write(np.ascontiguousarray(column(events), kind).data)

    def _finish(self) -> None:
        for file in self._files.values():
            file.flush()
        with zipfile.ZipFile(self._path, "w", zipfile.ZIP_STORED) as archive:
            for name, (kind, _) in self.columns.items():
                descr = npy.dtype_to_descr(np.dtype(kind))
                header = {"descr": descr, "fortran_order": False, "shape": (self._count,)}
                with (
                    archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as out,
                    self._parts[name].open("rb") as part,
                ):
                    npy.write_array_header_1_0(out, header)
                    shutil.copyfileobj(part, out, 1 << 20)
            for name, value in self._size_px.items():
                with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as out:
                    npy.write_array(out, np.array(value, np.int64))

    def _close(self) -> None:
        for file in self._files.values():
            file.close()
        for part in self._parts.values():
            part.unlink(missing_ok=True)


class SignedNpzWriter(NpzWriter):
    """Times are `t`, µs, and polarity is -1 or 1, as EventNeRF takes them."""

    columns: ClassVar[dict[str, _Written]] = {
        **{name: NpzWriter.columns[name] for name in "xy"},
        "t": NpzWriter.columns["t_us"],
        "p": (np.int8, lambda events: 2 * events.p.astype(np.int8) - 1),
    }
