"""PLY files: clouds, meshes and Gaussian splats, as columns by name; read without trust.

A header may claim anything: what is read is bounded by the bytes that follow it.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.inputs import check_file

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_NAMES = {"f8": "double", "f4": "float", "i4": "int", "u1": "uchar"}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_MOST_HEADER_BYTES, _MOST_ELEMENTS, _MOST_PROPERTIES = 1 << 16, 64, 1024
_BLOCK = 1 << 18  # rows
_INDICES = ("vertex_indices", "vertex_index")
Columns = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class _Property:
    """A column; of a list `count` is the type of its length."""

    name: str
    kind: str
    count: str = ""


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: tuple[_Property, ...]

    @property
    def is_plain(self) -> bool:
        """Whether each of them takes as many bytes as all others."""
        return not any(one.count for one in self.properties)


@dataclass(frozen=True, eq=False)
class PlyFile:
    """What a file holds.

    Attributes:
        vertices: columns of numbers by name, each (N,) float64.
        triangles: (T, 3) int64 numbers of vertices; polygons are cut into fans.
    """

    vertices: Columns
    triangles: NDArray[np.int64]


def read_ply(path: Path, only: Collection[str] | None = None) -> PlyFile:
    """Reads the vertices and faces of a PLY file, ASCII or binary.

    Args:
        path: the file.
        only: columns of the vertices that are kept, where it has them; all by default.

    Raises:
        InputError: no PLY, a damaged or impossible one, or one without vertices.
        OSError: it cannot be read.
    """
    check_file(path)
    size = path.stat().st_size
    with path.open("rb") as file:
        order, elements = _header(path, file)
        vertices: Columns | None = None
        triangles = np.empty((0, 3), np.int64)
        for element in elements:
            rows = _ascii(path, file, element, size) if not order else None
            if element.name == "vertex":
                if not element.is_plain:
                    raise InputError(f"{path}: its vertices hold lists; export plain coordinates")
                vertices = _plain(path, file, element, order, size, only) if order else _columns(
                    path, element, rows, only
                )  # fmt: skip
            elif element.name == "face":
                lists = _lists(path, file, element, order, size) if order else _ascii_lists(
                    path, element, rows
                )  # fmt: skip
                triangles = np.concatenate([np.empty((0, 3), np.int64), *lists])
            elif order:
                _skip(path, file, element, order, size)
    if vertices is None:
        raise InputError(f"{path}: a PLY file without the element vertex: export points or a mesh")
    return PlyFile(vertices, triangles)


def write_points(
    path: Path, columns: Mapping[str, NDArray[np.generic]], comments: Iterable[str] = ()
) -> None:
    """Writes columns as the vertices of a binary PLY file, whole or not at all."""
    kinds = {name: column.dtype.str[1:] for name, column in columns.items()}
    count = len(next(iter(columns.values())))
    vertices = np.empty(count, [(name, f"<{kind}") for name, kind in kinds.items()])
    for name, column in columns.items():
        vertices[name] = column
    header = [
        "ply", "format binary_little_endian 1.0", *(f"comment {text}" for text in comments),
        f"element vertex {count}",
        *(f"property {_NAMES[kind]} {name}" for name, kind in kinds.items()), "end_header", "",
    ]  # fmt: skip
    with atomic_path(path) as partial, partial.open("wb") as file:
        file.write("\n".join(header).encode("ascii"))
        vertices.tofile(file)


def _header(path: Path, file: BinaryIO) -> tuple[str, list[_Element]]:
    """The order of bytes, empty for ASCII, and what follows; the file then stands behind it."""
    head = file.read(_MOST_HEADER_BYTES)
    if head[:3] not in (b"ply",) or head[3:4] not in (b"\n", b"\r"):
        raise InputError(f"{path}: is no PLY file: its first line is not `ply`")
    end = head.find(b"end_header")
    line_end = head.find(b"\n", end)
    if end < 0 or line_end < 0:
        raise InputError(f"{path}: its header has no end; the file is damaged, export it again")
    file.seek(line_end + 1)
    lines = head[:end].decode("latin-1").splitlines()[1:]
    order, elements = None, []
    for words in (line.split() for line in lines):
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _ORDERS:
            order = _ORDERS[words[1]]
        elif (
            words[0] == "element" and len(words) == 3 and words[2].isascii() and words[2].isdigit()
        ):
            elements.append(_Element(words[1], int(words[2][:18]), ()))
        elif (one := _property(words)) is not None and elements:
            last = elements.pop()
            elements.append(_Element(last.name, last.count, (*last.properties, one)))
        else:
            raise InputError(f"{path}: {quoted(' '.join(words))} in its header is not understood")
    if order is None:
        raise InputError(f"{path}: its header names no format; the file is damaged")
    _check_elements(path, elements)
    return order, elements


def _property(words: list[str]) -> _Property | None:
    if words[0] != "property":
        return None
    if len(words) == 3 and words[1] in _TYPES:
        return _Property(words[2], _TYPES[words[1]])
    if len(words) == 5 and words[1] == "list" and words[2] in _TYPES and words[3] in _TYPES:
        count = _TYPES[words[2]]
        return None if count[0] == "f" else _Property(words[4], _TYPES[words[3]], count)
    return None


def _check_elements(path: Path, elements: list[_Element]) -> None:
    for element in elements:
        names = [one.name for one in element.properties]
        if len(names) > _MOST_PROPERTIES or len(elements) > _MOST_ELEMENTS:
            raise InputError(f"{path}: its header names more than any geometry has; it is damaged")
        if len(set(names)) < len(names) or (element.count and not names):
            raise InputError(
                f"{path}: the properties of {quoted(element.name)} are none or named twice"
            )


def _cut_off(path: Path, element: _Element) -> InputError:
    return InputError(
        f"{path}: ends before the {element.count:,} of {quoted(element.name)} that its header "
        "names: it is cut off or damaged, export it again"
    )


def _plain(
    path: Path, file: BinaryIO, element: _Element, order: str, size: int,
    only: Collection[str] | None,
) -> Columns:  # fmt: skip
    kinds = np.dtype([(one.name, order + one.kind) for one in element.properties])
    if element.count * kinds.itemsize > size - file.tell():
        raise _cut_off(path, element)
    columns = {name: np.empty(element.count) for name in _kept(element, only)}
    for first in range(0, element.count, _BLOCK):
        rows = np.fromfile(file, kinds, min(_BLOCK, element.count - first))
        for name, column in columns.items():
            column[first : first + len(rows)] = rows[name]
    return columns


def _kept(element: _Element, only: Collection[str] | None) -> list[str]:
    return [one.name for one in element.properties if only is None or one.name in only]


def _skip(path: Path, file: BinaryIO, element: _Element, order: str, size: int) -> None:
    if element.is_plain:
        file.seek(sum(np.dtype(one.kind).itemsize for one in element.properties) * element.count, 1)
        if file.tell() > size:
            raise _cut_off(path, element)
        return
    for _ in _records(path, file, element, order, size):
        pass


def _lists(
    path: Path, file: BinaryIO, element: _Element, order: str, size: int
) -> Iterator[NDArray[np.int64]]:
    """Triangles of binary faces: at once where all have as many corners, else one by one."""
    start = file.tell()
    index = _index_of(path, element)
    corners = _corners_of_all(file, element, order, index, size)
    if corners is not None:
        yield _fans(corners)
        return
    file.seek(start)
    for record in _records(path, file, element, order, size):
        if len(record[index]) >= 3:
            yield _fans(np.array([record[index]], np.int64))


def _index_of(path: Path, element: _Element) -> int:
    for k, one in enumerate(element.properties):
        if one.count and one.kind[0] != "f" and one.name in _INDICES:
            return k
    raise InputError(f"{path}: its faces have no {_INDICES[0]}: export it again as a mesh")


def _corners_of_all(
    file: BinaryIO, element: _Element, order: str, index: int, size: int
) -> NDArray[np.int64] | None:
    """(F, corners) of faces that are all alike, and have this one list; None for others."""
    lists = [one for one in element.properties if one.count]
    counts = np.dtype(order + lists[0].count)
    before = sum(np.dtype(one.kind).itemsize for one in element.properties[:index])
    start = file.tell()
    file.seek(before, 1)
    head = file.read(counts.itemsize)
    if len(lists) != 1 or len(head) < counts.itemsize or not element.count:
        return np.empty((0, 3), np.int64) if not element.count else None
    corners = int(np.frombuffer(head, counts)[0])
    file.seek(start)
    if not 0 < corners <= 64:
        return None
    columns = [
        (f"{k}", order + (one.count or one.kind)) for k, one in enumerate(element.properties)
    ]
    columns.insert(index + 1, ("corners", order + lists[0].kind, (corners,)))  # type: ignore[arg-type]
    kinds = np.dtype(columns)
    if element.count * kinds.itemsize > size - start:
        return None
    rows = np.fromfile(file, kinds, element.count)
    alike = bool((rows[f"{index}"] == corners).all())
    return rows["corners"].astype(np.int64) if alike else None


def _records(
    path: Path, file: BinaryIO, element: _Element, order: str, size: int
) -> Iterator[list[tuple[int, ...]]]:
    """Elements one by one, each property a tuple of its numbers."""
    for _ in range(element.count):
        record = []
        for one in element.properties:
            count = _unpacked(path, file, element, order + one.count, 1)[0] if one.count else 1
            if count < 0 or count * np.dtype(one.kind).itemsize > size - file.tell():
                raise _cut_off(path, element)
            record.append(_unpacked(path, file, element, order + one.kind, count))
        yield record


_CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}


def _unpacked(
    path: Path, file: BinaryIO, element: _Element, kind: str, count: int
) -> tuple[int, ...]:
    form = f"{kind[0]}{count}{_CODES[kind[1:]]}"
    data = file.read(struct.calcsize(form))
    if len(data) < struct.calcsize(form):
        raise _cut_off(path, element)
    return struct.unpack(form, data)


def _fans(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles of (F, corners) polygons, all from the first corner."""
    count = corners.shape[1]
    fans = [corners[:, [0, k, k + 1]] for k in range(1, count - 1)]
    return np.concatenate(fans) if fans else np.empty((0, 3), np.int64)


def _ascii(path: Path, file: BinaryIO, element: _Element, size: int) -> list[bytes]:
    """The lines of an element, without empty ones."""
    if element.count > size:
        raise _cut_off(path, element)
    filled = (line for line in file if line.strip())
    lines = list(itertools.islice(filled, element.count))
    if len(lines) < element.count:
        raise _cut_off(path, element)
    return lines


def _columns(
    path: Path, element: _Element, lines: list[bytes] | None, only: Collection[str] | None
) -> Columns:
    kept = _kept(element, only)
    if not lines:
        return {name: np.empty(0) for name in kept}
    try:
        rows = np.loadtxt(lines, np.float64, comments=None, ndmin=2, encoding="latin-1")
    except ValueError as error:
        raise InputError(f"{path}: its vertices are not rows of numbers: {error}") from error
    if rows.shape[1] != len(element.properties):
        raise InputError(
            f"{path}: its vertices have {rows.shape[1]} numbers, its header names "
            f"{len(element.properties)}"
        )
    named = {one.name: rows[:, k] for k, one in enumerate(element.properties)}
    return {name: named[name] for name in kept}


def _ascii_lists(
    path: Path, element: _Element, lines: list[bytes] | None
) -> Iterator[NDArray[np.int64]]:
    index = _index_of(path, element)
    for line in lines or ():
        words = iter(line.split())
        try:
            for k, one in enumerate(element.properties):
                count = int(next(words)) if one.count else 1
                corners = [float(word) for word in itertools.islice(words, max(count, 0))]
                if k == index and len(corners) == count and count >= 3:
                    yield _fans(np.array([corners], np.int64))
        except (ValueError, StopIteration, OverflowError) as error:
            raise InputError(f"{path}: its faces are not lists of whole numbers") from error
