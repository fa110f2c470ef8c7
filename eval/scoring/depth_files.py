"""Reads one depth map of anybody's making: npz, npy, 16-bit PNG, TIFF, EXR, or text points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import DAMAGED_NPY, InputError, refused
from eventsweep.emvs.formats.depth import decoded, read_exr
from eventsweep.emvs.utils.inputs import TABLE_BYTES, opened_npy, opened_npz, read_text

Image = NDArray[np.float64]


def read_stored(path: Path, height_px: int, width_px: int) -> Image:
    """Reads what a file stores per pixel, whatever it means: (H, W), NaN where it stores nothing.

    The suffix says the format, one of `SUFFIXES`.

    Raises:
        InputError: an unknown suffix, a damaged file, another size, or no plain numbers.
    """
    reader = SUFFIXES.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: unknown kind of file; needs one of {', '.join(SUFFIXES)}")
    image = reader(path, (height_px, width_px))
    if image.shape != (height_px, width_px):
        rows, columns = image.shape
        raise InputError(
            f"{path}: is {rows} rows and {columns} columns, but the reference view has {height_px} "
            f"rows and {width_px} columns: export it at the view's own size"
        )
    numbers: Image = image.astype(np.float64)
    return numbers


def depths_in(stored: Image) -> Image:
    """Finite and positive numbers, else NaN: no others are a depth or a disparity."""
    return np.where(np.isfinite(stored) & (stored > 0), stored, np.nan)


def read_confidence(path: Path, height_px: int, width_px: int) -> Image | None:
    """Reads the array `confidence` of an npz; None where there is none, and of other formats."""
    if path.suffix.lower() != ".npz":
        return None
    with _damaged(path, *DAMAGED_NPY), opened_npz(path) as file:
        found: NDArray[Any] | None = file.get("confidence")
    if found is None:
        return None
    if found.shape != (height_px, width_px) or found.dtype.kind not in "fui":
        raise InputError(
            f"{path}: confidence is {found.dtype} {found.shape}: needs numbers "
            f"{(height_px, width_px)}, as depth_m is"
        )
    if not np.isfinite(found).all():
        raise InputError(
            f"{path}: confidence is not finite everywhere: write 0 where there is none"
        )
    confidence: Image = found.astype(np.float64)
    return confidence


def is_integral(path: Path) -> bool:
    """Whether files of this kind hold whole numbers, whose scale must be given."""
    return path.suffix.lower() == ".png"


def _npz(path: Path, _shape: tuple[int, int]) -> NDArray[Any]:
    with _damaged(path, *DAMAGED_NPY), opened_npz(path) as file:
        arrays = {key: file[key] for key in ("depth_m", "mask") if key in file}
    if "depth_m" not in arrays:
        raise InputError(f"{path}: contains no array depth_m: name it so, in metres")
    numbers = _plain(path, arrays["depth_m"])
    mask = arrays.get("mask")
    if mask is None:
        return numbers
    if mask.shape != numbers.shape or mask.dtype != np.bool_:
        raise InputError(
            f"{path}: mask is {mask.dtype} {mask.shape}: needs bool {numbers.shape}, as depth_m is"
        )
    return np.where(mask, numbers, np.nan)


def _npy(path: Path, _shape: tuple[int, int]) -> NDArray[Any]:
    with _damaged(path, *DAMAGED_NPY):
        return _plain(path, np.asarray(opened_npy(path)))


def _png(path: Path, _shape: tuple[int, int]) -> NDArray[Any]:
    image = _decoded(path)
    if image.dtype != np.uint16:
        raise InputError(
            f"{path}: holds {image.dtype}, needs 16 bits per pixel: with 8 bits, depth has "
            "256 steps"
        )
    return image


def _float_image(path: Path, _shape: tuple[int, int]) -> NDArray[Any]:
    image = _decoded(path)
    if image.dtype.kind != "f":
        raise InputError(f"{path}: holds {image.dtype}, needs floating point")
    return image


def _exr(path: Path, _shape: tuple[int, int]) -> NDArray[Any]:
    channels = read_exr(path)
    if len(channels) != 1:
        names = ", ".join(sorted(channels)) or "none"
        raise InputError(f"{path}: has the channels {names}; needs exactly one")
    return _plain(path, next(iter(channels.values())))


def _points(path: Path, shape: tuple[int, int]) -> NDArray[Any]:
    """Rows of `column row number`, as the method authors' program writes them."""
    with _damaged(path, OSError, ValueError):
        lines = read_text(path, TABLE_BYTES).splitlines()
        if not any(lines):
            return np.full(shape, np.nan)
        table = np.loadtxt(lines, dtype=np.float64, ndmin=2, comments=None)
    if table.shape[1] != 3:
        raise InputError(
            f"{path}: has {table.shape[1]} numbers per line, needs 3: column row depth"
        )
    columns, rows = table[:, 0], table[:, 1]
    whole = (columns == np.floor(columns)) & (rows == np.floor(rows))
    inside = (columns >= 0) & (columns < shape[1]) & (rows >= 0) & (rows < shape[0])
    if not np.all(whole & inside):
        line = int(np.argmin(whole & inside))
        raise InputError(
            f"{path}: point {line + 1} lies at {columns[line]:g}, {rows[line]:g}: needs a whole "
            f"pixel of a view with {shape[1]} columns and {shape[0]} rows"
        )
    image = np.full(shape, np.nan)
    image[rows.astype(np.int64), columns.astype(np.int64)] = table[:, 2]
    return image


def _decoded(path: Path) -> NDArray[Any]:
    return _plain(path, decoded(path))


def _plain(path: Path, array: NDArray[Any]) -> NDArray[Any]:
    if array.ndim != 2 or array.dtype.kind not in "fui":
        raise InputError(f"{path}: holds {array.dtype} {array.shape}, needs (H, W) numbers")
    return array


def _damaged(path: Path, *faults: type[Exception]) -> AbstractContextManager[None]:
    return refused(f"{path}: cannot be read", *faults, cure=": export it again")


SUFFIXES: Mapping[str, Callable[[Path, tuple[int, int]], NDArray[Any]]] = {
    ".npz": _npz, ".npy": _npy, ".png": _png, ".tif": _float_image, ".tiff": _float_image,
    ".exr": _exr, ".txt": _points,
}  # fmt: skip
