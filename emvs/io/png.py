"""Reads PNG images of data sets: damage and impossible sizes are found before they are unpacked.

OpenCV's decoder prints what it thinks of damage and reserves what a header declares; so the chunks'
check sums and the header's size are checked first.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_MOST_PIXELS = 1 << 26
_MOST_BYTES = 1 << 28


def read_png(path: Path, flags: int = cv2.IMREAD_UNCHANGED) -> NDArray[np.uint8 | np.uint16]:
    """Reads an image.

    Args:
        path: the file.
        flags: OpenCV's, such as `cv2.IMREAD_GRAYSCALE`.

    Returns:
        (H, W) or (H, W, C), of the file's own depth.

    Raises:
        InputError: an unreadable file, no whole PNG, or more than 2^26 pixels.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path}: more than {_MOST_BYTES} bytes; needs a PNG image")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); needs a PNG image") from error
    try:
        width, height = _checked_size(data)
    except (ValueError, struct.error) as error:
        raise InputError(f"{path}: no whole PNG image ({error}); fetch it again") from error
    if not 1 <= width * height <= _MOST_PIXELS:
        raise InputError(f"{path}: declares {width}x{height} pixels; at most 2^26 are read")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if image is None:
        raise InputError(f"{path}: no readable PNG image; fetch it again")
    return np.asarray(image)


def _checked_size(data: bytes) -> tuple[int, int]:
    """Width and height; a `ValueError` says what is wrong with the chunks."""
    if data[:8] != _SIGNATURE:
        raise ValueError("its first bytes are another format's")
    at, size, kind = 8, (0, 0), b""
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 8 + length
        (expected,) = struct.unpack_from(">I", data, end)
        if zlib.crc32(memoryview(data)[at + 4 : end]) != expected:
            raise ValueError(f"check sum of the chunk at byte {at} is wrong")
        if at == 8:
            if kind != b"IHDR" or length != 13:
                raise ValueError("its first chunk is no header")
            size = struct.unpack_from(">II", data, at + 8)
        at = end + 4
    return size
