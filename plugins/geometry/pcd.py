"""PCD files of point clouds, as the Point Cloud Library writes them; read without trust."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.utils.inputs import check_file
from eventsweep.plugins.geometry.pcd_kernels import unpacked

_TYPES = {
    ("F", "4"): "<f4", ("F", "8"): "<f8",
    **{("I", str(n)): f"<i{n}" for n in (1, 2, 4, 8)},
    **{("U", str(n)): f"<u{n}" for n in (1, 2, 4, 8)},
}  # fmt: skip
_MOST_HEADER_LINES, _MOST_LINE_BYTES, _MOST_FIELDS = 64, 4096, 256
_MOST_EXPANSION = 300  # LZF repeats at most 264 bytes by 3
Fields = dict[str, str]


def read_pcd(path: Path) -> NDArray[np.float64]:
    """Reads the (N, 3) points of a PCD file: ASCII, binary or compressed.

    Of an organised cloud, an image of points, those without coordinates are left out.

    Raises:
        InputError: no PCD, a damaged or impossible one, or one without x, y and z.
        OSError: it cannot be read.
    """
    check_file(path)
    size = path.stat().st_size
    with path.open("rb") as file:
        fields = _header(path, file)
        kinds = _kinds(path, fields)
        count = _whole(path, fields, "POINTS") if "POINTS" in fields else (
            _whole(path, fields, "WIDTH") * _whole(path, fields, "HEIGHT")
        )  # fmt: skip
        left = size - file.tell()
        data = fields["DATA"].lower()
        if data == "ascii":
            points = _ascii(path, file, kinds, count, left)
        elif data == "binary":
            if count * kinds.itemsize > left:
                raise _cut_off(path, count)
            points = _places(np.fromfile(file, kinds, count))
        else:
            points = _compressed(path, file, kinds, count, left)
    if fields.get("HEIGHT", "1") != "1":
        points = points[np.isfinite(points).all(axis=1)]
    return points


def _header(path: Path, file: BinaryIO) -> Fields:
    fields: Fields = {}
    for _ in range(_MOST_HEADER_LINES):
        line = file.readline(_MOST_LINE_BYTES).decode("latin-1")
        name, _, value = line.strip().partition(" ")
        if name and not name.startswith("#"):
            fields[name.upper()] = value.strip()
        if name.upper() == "DATA":
            break
    if fields.get("DATA", "").lower() not in ("ascii", "binary", "binary_compressed"):
        raise InputError(f"{path}: is no PCD file: its header has no DATA that is known")
    return fields


def _kinds(path: Path, fields: Fields) -> np.dtype[np.void]:
    """The type of a point; what has several numbers, as a histogram has, keeps them together."""
    names = fields.get("FIELDS", fields.get("COLUMNS", "")).split()
    sizes, types = fields.get("SIZE", "").split(), fields.get("TYPE", "").upper().split()
    counts = fields.get("COUNT", " ".join("1" * len(names))).split()
    if not {"x", "y", "z"} <= set(names) or len(names) > _MOST_FIELDS:
        raise InputError(f"{path}: its header names no fields x, y and z: export coordinates")
    columns = []
    for k, described in enumerate(zip(names, types, sizes, counts, strict=False)):
        name, kind, size, count = described
        if (kind, size) not in _TYPES or not count.isascii() or not count.isdigit():
            raise InputError(f"{path}: its field {quoted(name)} has no type that is known")
        # `_` is padding, any number of times
        columns.append((f"{name}{k if name == '_' else ''}", _TYPES[kind, size], (int(count[:6]),)))
    if len(columns) < len(names) or len({name for name, *_ in columns}) < len(names):
        raise InputError(f"{path}: its header describes {len(columns)} of {len(names)} fields")
    if any(count != (1,) for name, _, count in columns if name in "xyz"):
        raise InputError(f"{path}: has several x, y or z of a point; it is damaged")
    return np.dtype(columns)


def _whole(path: Path, fields: Fields, name: str) -> int:
    text = fields.get(name, "")
    if not text.isascii() or not text.isdigit() or len(text) > 18:
        raise InputError(f"{path}: its header has {name} {quoted(text)}; needs a whole number")
    return int(text)


def _cut_off(path: Path, count: int) -> InputError:
    return InputError(
        f"{path}: ends before the {count:,} points that its header names: it is cut off or "
        "damaged, export it again"
    )


def _places(rows: NDArray[np.void]) -> NDArray[np.float64]:
    return np.column_stack([rows[axis].reshape(-1).astype(np.float64) for axis in "xyz"])


def _ascii(
    path: Path, file: BinaryIO, kinds: np.dtype[np.void], count: int, left: int
) -> NDArray[np.float64]:
    if count > left:
        raise _cut_off(path, count)
    if not count:
        return np.empty((0, 3))
    widths = {name: int(np.prod(kinds[name].shape)) for name in kinds.names or ()}
    first = dict(zip(widths, np.cumsum([0, *widths.values()]), strict=False))
    filled = itertools.islice((line for line in file if line.strip()), count)
    lines = list(filled)
    if len(lines) < count:
        raise _cut_off(path, count)
    try:
        rows = np.loadtxt(lines, np.float64, comments=None, ndmin=2, encoding="latin-1")
    except ValueError as error:
        raise InputError(f"{path}: its points are not rows of numbers: {error}") from error
    if rows.shape[1] != sum(widths.values()):
        raise InputError(
            f"{path}: its points have {rows.shape[1]} numbers, {sum(widths.values())} are named"
        )
    return rows[:, [first[axis] for axis in "xyz"]]


def _compressed(
    path: Path, file: BinaryIO, kinds: np.dtype[np.void], count: int, left: int
) -> NDArray[np.float64]:
    """Column after column, packed together behind both sizes."""
    wanted = count * kinds.itemsize
    sizes = np.frombuffer(file.read(8), "<u4") if left >= 8 else np.zeros(2, "<u4")
    if left < 8 or sizes[0] > left - 8 or wanted > _MOST_EXPANSION * int(sizes[0]):
        raise _cut_off(path, count)
    packed = np.frombuffer(file.read(int(sizes[0])), np.uint8)
    out = np.empty(wanted, np.uint8)
    if sizes[1] != wanted or not unpacked(packed, out):
        raise InputError(f"{path}: its compressed points are damaged; export it again")
    columns, at = [], 0
    for name in kinds.names or ():
        width = kinds[name].itemsize * count
        if name in ("x", "y", "z"):
            columns.append((name, out[at : at + width].view(kinds[name].base)))
        at += width
    by_name = dict(columns)
    return np.column_stack([by_name[axis].astype(np.float64) for axis in "xyz"])
