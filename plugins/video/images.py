"""One image file as an array, whole or refused: PNG, JPEG, TIFF, OpenEXR, npy."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import DAMAGED_NPY, InputError, said
from eventsweep.emvs.formats.depth import decoded, read_exr
from eventsweep.emvs.utils.inputs import check_file, opened_npy

Image = NDArray[Any]
"""(H, W) grey levels or (H, W, 3) red, green, blue; uint8, uint16 or float32."""

_DAMAGED: tuple[type[Exception], ...] = (*DAMAGED_NPY, TypeError)
_MOST_PIXELS = 1 << 26
_MOST_BYTES = 1 << 30
_OPAQUE = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535, np.dtype(np.float32): 1}


def read_image(path: Path) -> Image:
    """Reads an image file as it is: (H, W) or (H, W, 3), of uint8, uint16 or float32.

    Raises:
        InputError: unreadable, truncated, damaged, empty, larger than 2^26 pixels, transparent, or
            values of another kind.
    """
    try:
        check_file(path, _MOST_BYTES)
        image = READERS[path.suffix.lower()](path)
    except InputError:
        raise
    except OSError as error:
        reason = error.strerror or said(error)
        raise InputError(f"{path}: cannot be read ({reason}); needs a complete image") from error
    return _checked(path, image)


def _jpeg(path: Path) -> Image:
    # Pillow refuses a truncated file; OpenCV may fill it with grey.
    from PIL import Image as Pillow

    try:
        with Pillow.open(io.BytesIO(path.read_bytes()), formats=("JPEG", "MPO")) as image:
            _check_size(path, *image.size)
            return np.asarray(image if image.mode == "L" else image.convert("RGB"))
    except InputError:
        raise
    except Exception as error:  # Pillow ends in many kinds of exception on damaged files
        raise InputError(f"{path}: not a complete JPEG ({said(error)}); export it again") from error


def _decoded(path: Path) -> NDArray[Any]:
    """A PNG or TIFF, colours as red, green, blue."""
    image = decoded(path)
    if image.ndim == 3 and image.shape[2] >= 3:
        image = image[..., [2, 1, 0, *range(3, image.shape[2])]]
    return image


def _npy(path: Path) -> NDArray[Any]:
    try:
        stored = opened_npy(path)
        kind = np.float32 if stored.dtype.kind == "f" else stored.dtype
        _check_size(path, *stored.shape[1::-1])
        return np.asarray(stored, kind)
    except InputError:
        raise
    except _DAMAGED as error:
        raise InputError(f"{path}: not a complete npy ({said(error)}); export it again") from error


def _exr(path: Path) -> Image:
    planes = read_exr(path)
    names = "RGB" if {*"RGB"} <= planes.keys() else "Y"
    if not {*names} <= planes.keys():
        raise InputError(f"{path}: channels {', '.join(planes)}; needs Y, or R, G and B")
    chosen = [planes[name] for name in (*names, *("A" * ("A" in planes and names == "RGB")))]
    return np.stack(chosen, axis=-1)


READERS: dict[str, Callable[[Path], NDArray[Any]]] = {
    ".png": _decoded, ".jpg": _jpeg, ".jpeg": _jpeg, ".tif": _decoded, ".tiff": _decoded,
    ".exr": _exr, ".npy": _npy,
}  # fmt: skip
"""End of a file's name -> what reads it."""


def _check_size(path: Path, *sides: int) -> None:
    if not 0 < int(np.prod(sides, dtype=np.float64)) <= _MOST_PIXELS or len(sides) != 2:
        size = "x".join(map(str, sides))
        raise InputError(f"{path}: an image of {size} pixels; needs at least 1, at most 2^26")


def _checked(path: Path, image: NDArray[Any]) -> Image:
    """The image without an opaque alpha channel, or a single one's axis."""
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)):
        raise InputError(f"{path}: shape {image.shape}; needs (H, W) or (H, W, 3)")
    _check_size(path, *image.shape[1::-1])
    if image.dtype not in _OPAQUE:
        raise InputError(f"{path}: values of {image.dtype}; needs 8 or 16 bits, or float32")
    if image.ndim == 3 and image.shape[2] == 4:
        if (image[..., 3] != _OPAQUE[image.dtype]).any():
            raise InputError(f"{path}: has transparent pixels; flatten it onto a background first")
        image = image[..., :3]
    return image[..., 0] if image.ndim == 3 and image.shape[2] == 1 else image
