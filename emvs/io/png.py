"""Reads PNG images of data sets: damage and impossible sizes are found before they are unpacked."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from emvs.io.events.wording import said

if TYPE_CHECKING:
    from PIL.PngImagePlugin import PngImageFile

_MOST_PIXELS = 1 << 26
_MOST_BYTES = 1 << 28
_END = bytes(4) + b"IEND" + zlib.crc32(b"IEND").to_bytes(4, "big")
_DAMAGE = (OSError, SyntaxError, ValueError, EOFError, struct.error, zlib.error, UserWarning)


def read_png(path: Path) -> NDArray[np.uint8 | np.uint16]:
    """Reads an image as it is stored.

    Returns:
        (H, W) grey levels, uint16 where the file has 16 bits and else uint8; or (H, W, 2 to 4)
        uint8 colours and opacity, of 16 bits the upper eight.

    Raises:
        InputError: an unreadable file, no whole PNG, or more than 2^26 pixels.
    """
    image = _checked(path)
    if image.mode == "1":
        return np.asarray(image.convert("L"))
    if image.mode == "P":
        return np.asarray(image.convert("RGBA"))
    return np.asarray(image)


def read_grey(path: Path) -> NDArray[np.uint8]:
    """Reads an image as (H, W) uint8 grey levels, of 16 bits the upper eight.

    Raises:
        InputError: as `read_png`.
    """
    image = _checked(path)
    if image.mode == "I;16":  # Pillow would clip what does not fit eight bits
        return (np.asarray(image) >> 8).astype(np.uint8)
    return np.asarray(image.convert("L"))


def _checked(path: Path) -> PngImageFile:
    """The decoded image of a file whose check sums hold."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path}: more than {_MOST_BYTES} bytes; needs a PNG image")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); needs a PNG image") from error
    try:
        with warnings.catch_warnings(action="error", category=UserWarning):
            _check(path, data)
            return _decoded(data)
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(f"{path}: no whole PNG image ({said(error)}); fetch it again") from error


def _check(path: Path, data: bytes) -> None:
    """Refuses impossible sizes and wrong check sums; what is raised says which."""
    from PIL.PngImagePlugin import PngImageFile  # recordings without images need not wait for it

    # `Image.open` would warn of sizes by a limit of its own, and not say what is damaged
    stream = io.BytesIO(data)
    image = PngImageFile(stream)
    width_px, height_px = image.size
    if width_px * height_px > _MOST_PIXELS:
        raise InputError(f"{path}: declares {width_px}x{height_px} pixels; at most 2^26 are read")
    image.verify()  # every chunk but the last, whose eight first bytes have been read
    at = stream.tell()
    if data[at - 8 : at + 4] != _END:
        raise ValueError("its last chunk is damaged")


def _decoded(data: bytes) -> PngImageFile:
    from PIL.PngImagePlugin import PngImageFile

    image = PngImageFile(io.BytesIO(data))
    image.load()
    return image
