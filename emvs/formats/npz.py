"""Events as columns in an npz archive, read and written; nothing is ever unpickled.

Members `x`, `y`, `p` and a time: `t_us`, `t_ns`, `t_s`, or `t` (µs where whole, seconds where
floating); optionally `width_px` and `height_px`. Columns are read as streams, so that memory holds
a block of them, compressed or not.
"""

from __future__ import annotations

import io
import shutil
import struct
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events
from emvs.errors import InputError, quoted, said
from emvs.formats.base import StreamWriter
from emvs.formats.blocks import BlockReader, to_events
from emvs.formats.prophesee import STREAM, opened

_TIMES = {"t_us": 1e-6, "t_ns": 1e-9, "t_s": 1.0, "t": None, "ts": None, "timestamps": None}
_POLARITIES = ("p", "pol", "polarity")
_ROWS = 1 << 18
_MOST_HEADER = 1 << 14
_COLUMNS: dict[str, type[np.generic]] = {
    "x": np.uint16,
    "y": np.uint16,
    "t_us": np.int64,
    "p": np.uint8,
}


@dataclass(frozen=True, slots=True)
class _Column:
    """A member of the archive.

    Attributes:
        name: as the archive has it, without `.npy`.
        count: how many values it declares.
        kind: their type.
        head: bytes in front of the values.
        place: where the values lie in the file, byte; None where they are compressed.
    """

    name: str
    count: int
    kind: np.dtype[Any]
    head: int
    place: int | None


class NpzReader(BlockReader):
    """An archive of columns: one stream, `events`.

    Raises:
        InputError: a missing or damaged archive, missing columns, or columns that do not match.
    """

    format = "npz"

    def __init__(self, path: Path) -> None:
        super().__init__(Path(path), (STREAM,))
        with _archive(self.path) as archive:
            names = {name.removesuffix(".npy") for name in archive.namelist()}
            chosen = _choose(self.path, names)
            self._columns = [_column(self.path, archive, name) for name in chosen]
            self.width_px, self.height_px = (
                _scalar(self.path, archive, name) if name in names else None
                for name in ("width_px", "height_px")
            )
        counts = {column.name: column.count for column in self._columns}
        if len(set(counts.values())) != 1:
            raise InputError(f"{self.path}: columns of lengths {counts}; needs one length")
        self._count = counts["x"]

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads all columns side by side, and so checks the archive's sums."""
        del stream
        with _archive(self.path) as archive, ExitStack() as stack:
            files = [_member(archive, stack, column, 0) for column in self._columns]
            for start in range(0, self._count, _ROWS):
                stop = min(start + _ROWS, self._count)
                yield (start, stop), self._read(files, start, stop)

    def load(self, stream: str, place: Any) -> Events:
        """Reads one block: straight from the file where it is not compressed."""
        del stream
        with _archive(self.path) as archive, ExitStack() as stack:
            files = [self._at(archive, stack, column, place[0]) for column in self._columns]
            return self._read(files, *place)

    def share_before(self, stream: str, place: Any) -> float:
        """Which share of the rows ends with a block."""
        del stream
        return float(place[1] / max(1, self._count))

    def _at(
        self, archive: zipfile.ZipFile, stack: ExitStack, column: _Column, row: int
    ) -> IO[bytes]:
        if column.place is None:
            return _member(archive, stack, column, row)
        file = stack.enter_context(opened(self.path))
        file.seek(column.place + row * column.kind.itemsize)
        return file

    def _read(self, files: list[IO[bytes]], start: int, stop: int) -> Events:
        values = []
        for column, file in zip(self._columns, files, strict=True):
            size = (stop - start) * column.kind.itemsize
            data = file.read(size)
            if len(data) != size:
                raise InputError(
                    f"{self.path}, column {column.name}: ends before row {stop} of {self._count}; "
                    "the file is damaged, fetch it again"
                )
            values.append(np.frombuffer(data, column.kind))
        x, y, t, p = values
        where = f"{self.path}, rows {start} to {stop}"
        return to_events(where, x, y, t, p, _TIMES[self._columns[2].name])


def _choose(path: Path, names: set[str]) -> tuple[str, str, str, str]:
    time = next((name for name in _TIMES if name in names), "")
    polarity = next((name for name in _POLARITIES if name in names), "")
    if not (time and polarity and {"x", "y"} <= names):
        raise InputError(
            f"{path}: columns {quoted(*sorted(names)) or 'none'}; needs x, y, p and one "
            f"of {', '.join(_TIMES)}: rename them"
        )
    return "x", "y", time, polarity


def _column(path: Path, archive: zipfile.ZipFile, name: str) -> _Column:
    """Looks a column up; refuses a count that the archive contradicts."""
    info = archive.getinfo(f"{name}.npy")
    with archive.open(info) as member:
        shape, kind = _header(path, name, member)
        head = member.tell()
    if len(shape) != 1:
        raise InputError(f"{path}, column {name}: shape {shape}; needs (N,)")
    size = info.file_size - head
    if size != shape[0] * kind.itemsize:
        raise InputError(
            f"{path}, column {name}: {shape[0]} rows of {kind.itemsize} bytes declared, "
            f"{size} bytes there; the file is damaged, fetch it again"
        )
    place = None
    if info.compress_type == zipfile.ZIP_STORED:
        place = _content_at(path, info.header_offset) + head
    return _Column(name, shape[0], kind, head, place)


def _content_at(path: Path, header_at: int) -> int:
    """Where a member's bytes begin: behind 30 bytes, a name and a field of any length."""
    with opened(path) as file:
        file.seek(header_at + 26)
        name, extra = struct.unpack("<HH", file.read(4))
        return int(header_at + 30 + name + extra)


def _member(archive: zipfile.ZipFile, stack: ExitStack, column: _Column, row: int) -> IO[bytes]:
    """A column opened at a row, by unpacking what comes before it."""
    member = stack.enter_context(archive.open(f"{column.name}.npy"))
    member.seek(column.head + row * column.kind.itemsize)
    return member


@contextmanager
def _archive(path: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except InputError:
        raise
    except Exception as error:  # of zipfile, of four decompressors, and of damaged names
        raise InputError(
            f"{path}: not a complete npz archive ({said(error)}); make it again"
        ) from error


def _header(path: Path, name: str, member: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type; leaves the member where its values begin."""
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
        shape, _, kind = read(io.BytesIO(size + member.read(length)))
    except (ValueError, TypeError, SyntaxError, OSError, RecursionError) as error:
        raise InputError(
            f"{path}, column {name}: no npy header ({said(error)}); make the archive again"
        ) from error
    if kind.kind not in "iufb" or kind.itemsize > 8:
        raise InputError(
            f"{path}, column {name}: of type {kind}; needs plain numbers of up to 8 bytes"
        )
    return shape, kind


def _scalar(path: Path, archive: zipfile.ZipFile, name: str) -> int:
    with archive.open(f"{name}.npy") as member:
        shape, kind = _header(path, name, member)
        data = member.read(kind.itemsize)
    value: NDArray[Any] = np.frombuffer(data, kind)
    if shape not in ((), (1,)) or len(value) != 1 or not 0 < value[0] <= 1 << 16:
        raise InputError(f"{path}, {name}: needs one whole number, 1 to 65536")
    return int(value[0])


class NpzWriter(StreamWriter):
    """Appends to one plain file per column; the archive is put together at the end."""

    packet = 1 << 20

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._path, self._size_px = path, {"width_px": width_px, "height_px": height_px}
        self._count = 0
        self._parts = {name: path.with_name(f"{path.name}.{name}") for name in _COLUMNS}
        self._files = {name: part.open("wb") for name, part in self._parts.items()}

    def _put(self, stream: str, events: Events) -> None:
        del stream
        self._count += len(events)
        for name, kind in _COLUMNS.items():
            self._files[name].write(np.ascontiguousarray(getattr(events, name), kind).data)

    def _finish(self) -> None:
        for file in self._files.values():
            file.flush()
        with zipfile.ZipFile(self._path, "w", zipfile.ZIP_STORED) as archive:
            for name, kind in _COLUMNS.items():
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


def _write_header(out: IO[bytes], kind: type[np.generic], shape: tuple[int, ...]) -> None:
    descr = np.lib.format.dtype_to_descr(np.dtype(kind))
    header = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(out, header)
