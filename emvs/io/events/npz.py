"""Reads and writes events as columns in an npz archive; nothing is ever unpickled.

Members `x`, `y`, `p` and a time: `t_us`, `t_ns`, `t_s`, or `t` (µs where whole, seconds where
floating); optionally `width_px` and `height_px`. Columns are read as streams, so that memory holds
a block of them, compressed or not.
"""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events
from emvs.errors import InputError
from emvs.io.events.convert_columns import to_events
from emvs.io.events.indexed import BlockReader
from emvs.io.events.raw import STREAM

_TIMES = {"t_us": 1e-6, "t_ns": 1e-9, "t_s": 1.0, "t": None, "ts": None, "timestamps": None}
_POLARITIES = ("p", "pol", "polarity")
_ROWS = 1 << 18
_COLUMNS: dict[str, type[np.generic]] = {
    "x": np.uint16,
    "y": np.uint16,
    "t_us": np.int64,
    "p": np.uint8,
}


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
            self._columns = self._choose(names)
            counts = {}
            for name in self._columns:
                with archive.open(f"{name}.npy") as member:
                    counts[name] = _header(self.path, name, member)[0]
                    self._check_size(archive, name, member, counts[name])
            self.width_px, self.height_px = (
                _scalar(self.path, archive, name) if name in names else None
                for name in ("width_px", "height_px")
            )
        if len(set(counts.values())) != 1:
            raise InputError(f"{self.path}: columns of lengths {counts}; needs one length")
        self._count = counts["x"]

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads all columns side by side."""
        del stream
        with _archive(self.path) as archive, ExitStack() as stack:
            members = [stack.enter_context(archive.open(f"{n}.npy")) for n in self._columns]
            kinds = [
                _header(self.path, n, m)[1] for n, m in zip(self._columns, members, strict=True)
            ]
            for start in range(0, self._count, _ROWS):
                stop = min(start + _ROWS, self._count)
                yield (start, stop), self._read(members, kinds, start, stop)

    def load(self, stream: str, place: Any) -> Events:
        """Reads one block."""
        del stream
        with _archive(self.path) as archive, ExitStack() as stack:
            members = [stack.enter_context(archive.open(f"{n}.npy")) for n in self._columns]
            kinds = [
                _header(self.path, n, m)[1] for n, m in zip(self._columns, members, strict=True)
            ]
            for kind, member in zip(kinds, members, strict=True):
                member.seek(place[0] * kind.itemsize, 1)
            return self._read(members, kinds, *place)

    def _read(
        self, members: list[IO[bytes]], kinds: list[np.dtype[Any]], start: int, stop: int
    ) -> Events:
        columns = []
        for name, kind, member in zip(self._columns, kinds, members, strict=True):
            data = member.read((stop - start) * kind.itemsize)
            if len(data) != (stop - start) * kind.itemsize:
                raise InputError(
                    f"{self.path}, column {name}: ends before row {stop} of {self._count}; the "
                    "file is damaged, fetch it again"
                )
            columns.append(np.frombuffer(data, kind))
        x, y, t, p = columns
        where = f"{self.path}, rows {start} to {stop}"
        return to_events(where, x, y, t, p, _TIMES[self._columns[2]])

    def _choose(self, names: set[str]) -> tuple[str, str, str, str]:
        time = next((name for name in _TIMES if name in names), "")
        polarity = next((name for name in _POLARITIES if name in names), "")
        if not (time and polarity and {"x", "y"} <= names):
            raise InputError(
                f"{self.path}: columns {', '.join(sorted(names)) or 'none'}; needs x, y, p and one "
                f"of {', '.join(_TIMES)}: rename them"
            )
        return "x", "y", time, polarity

    def _check_size(
        self, archive: zipfile.ZipFile, name: str, member: IO[bytes], count: int
    ) -> None:
        """Refuses counts that the archive itself contradicts, before anything is reserved."""
        member.seek(0)
        _, kind = _header(self.path, name, member)
        size = archive.getinfo(f"{name}.npy").file_size - member.tell()
        if size != count * kind.itemsize:
            raise InputError(
                f"{self.path}, column {name}: {count} rows of {kind.itemsize} bytes declared, "
                f"{size} bytes there; the file is damaged, fetch it again"
            )


class NpzWriter:
    """Appends to one plain file per column; the archive is put together at the end."""

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._path, self._size_px = path, {"width_px": width_px, "height_px": height_px}
        self._count = 0
        self._parts = {name: path.with_name(f"{path.name}.{name}") for name in _COLUMNS}
        self._files = {name: part.open("wb") for name, part in self._parts.items()}

    def append(self, stream: str, events: Events) -> None:
        """Writes a packet."""
        del stream
        self._count += len(events)
        for name, kind in _COLUMNS.items():
            self._files[name].write(np.ascontiguousarray(getattr(events, name), kind).data)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            for file in self._files.values():
                file.close()
            if error is None:
                self._assemble()
        finally:
            for part in self._parts.values():
                part.unlink(missing_ok=True)

    def _assemble(self) -> None:
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


def _write_header(out: IO[bytes], kind: type[np.generic], shape: tuple[int, ...]) -> None:
    descr = np.lib.format.dtype_to_descr(np.dtype(kind))
    header = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(out, header)


@contextmanager
def _archive(path: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except (OSError, zipfile.BadZipFile, zipfile.LargeZipFile, EOFError, KeyError) as error:
        raise InputError(f"{path}: not a whole npz archive ({error}); make it again") from error
    except (NotImplementedError, RuntimeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a readable npz archive ({error})") from error
    except Exception as error:  # zlib.error derives from nothing narrower
        raise InputError(f"{path}: damaged npz archive ({error}); make it again") from error


def _header(path: Path, name: str, member: IO[bytes]) -> tuple[int, np.dtype[Any]]:
    """Rows and type of a column; leaves the member where its values begin."""
    shape, kind = _any_header(path, name, member)
    if len(shape) != 1:
        raise InputError(f"{path}, column {name}: shape {shape}; needs (N,)")
    return shape[0], kind


def _any_header(path: Path, name: str, member: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    try:
        version = np.lib.format.read_magic(member)
        read = (
            np.lib.format.read_array_header_1_0
            if version == (1, 0)
            else np.lib.format.read_array_header_2_0
        )
        shape, _, kind = read(member)
    except (ValueError, TypeError, SyntaxError, OSError, MemoryError, RecursionError) as error:
        raise InputError(f"{path}, column {name}: no npy header ({error})") from error
    if kind.kind not in "iufb" or kind.itemsize > 8:
        raise InputError(f"{path}, column {name}: of type {kind}; needs plain numbers")
    return shape, kind


def _scalar(path: Path, archive: zipfile.ZipFile, name: str) -> int:
    with archive.open(f"{name}.npy") as member:
        shape, kind = _any_header(path, name, member)
        data = member.read(kind.itemsize)
    value: NDArray[Any] = np.frombuffer(data, kind)
    if shape not in ((), (1,)) or len(value) != 1 or not 0 < value[0] <= 1 << 16:
        raise InputError(f"{path}, {name}: needs one whole number, 1 to 65536")
    return int(value[0])
