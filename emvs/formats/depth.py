"""Depth and disparity maps as files: written as PNG, npy, TIFF or EXR; PNG read with care."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, refused
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.inputs import TABLE_BYTES, check_file, opened_npy, opened_npz
from eventsweep.emvs.utils.plugins import extra_module

if TYPE_CHECKING:
    from PIL.PngImagePlugin import PngImageFile

PNG_UNIT_M = 0.001  # a 16-bit depth PNG counts millimetres; 0 means unknown
_MOST_PIXELS = 1 << 28
_MOST_READ_PIXELS = 1 << 26
_MOST_BYTES = 1 << 30
_MOST_TAGS = 1 << 12
_TIFF_SIDES = 256, 257, 322, 323  # tags: width and height of the image, and of a tile
_TIFF_NUMBERS = {3: "H", 4: "I", 16: "Q"}
_AGAIN = "; export it again"
_END = bytes(4) + b"IEND" + zlib.crc32(b"IEND").to_bytes(4, "big")
_DAMAGE = (OSError, SyntaxError, ValueError, EOFError, struct.error, zlib.error, UserWarning)


def read_depth(path: Path) -> NDArray[np.float32]:
    """Reads an npz like a map's, or an npy: (H, W) z-depth in m, NaN where unknown or masked.

    An npz has `depth_m`, and maybe `mask`, true where the depth counts.

    Raises:
        InputError: an unreadable file, or one that is no depth map; pickles are never loaded.
    """
    # numpy ends in many kinds of exception on damaged files
    with refused(f"{path}: not a depth map", Exception, cure="; needs a depth.npz or a .npy file"):
        if path.suffix == ".npz":
            with opened_npz(path) as stored:
                depth_m = stored["depth_m"]
                if "mask" in stored:
                    depth_m = np.where(stored["mask"], depth_m, np.nan)
        else:
            mapped = opened_npy(path)
            if mapped.ndim != 2 or mapped.size > _MOST_PIXELS or mapped.dtype.kind not in "fiu":
                raise InputError(f"{path}: shape {mapped.shape}, {mapped.dtype}; needs (H, W) in m")
            depth_m = np.asarray(mapped)
    return np.asarray(np.where(depth_m > 0, depth_m, np.nan), np.float32)


def read_exr(path: Path) -> dict[str, NDArray[np.float32]]:
    """Reads an EXR image: (H, W) of each channel, by name.

    Raises:
        InputError: an unreadable or damaged file, or more than 2^26 pixels.
    """
    _check_exr(path, _bytes_of(path, "an EXR image"))
    OpenEXR = extra_module("OpenEXR", f"{path}: reading EXR needs OpenEXR", "exr")
    # It raises anything for damage, and prints it, which would stand among a summary's numbers.
    with (
        refused(f"{path}: not a complete EXR", Exception, cure=_AGAIN),
        redirect_stdout(io.StringIO()),
        OpenEXR.File(str(path), separate_channels=True) as file,
    ):
        channels = file.channels().items()
        return {name: np.asarray(channel.pixels, np.float32) for name, channel in channels}


def write_depth_png(path: Path, depth_m: NDArray[np.float32]) -> None:
    """Writes millimetres in 16 bits; loses fractions of one."""
    known = np.isfinite(depth_m)
    units = np.rint(np.where(known, depth_m, 0) / PNG_UNIT_M)
    if units.max(initial=0) > 65535:
        raise InputError(
            f"{path}: depth up to {np.nanmax(depth_m):g} m, but 16-bit millimetres end at 65.535 "
            "m: choose depth-npy, depth-tiff or depth-exr"
        )
    write_image(path, ".png", units.astype(np.uint16))


def write_depth_npy(path: Path, depth_m: NDArray[np.float32]) -> None:
    """Writes 32-bit floats, m, NaN where unknown."""
    with atomic_path(path) as partial, partial.open("wb") as file:
        np.save(file, np.asarray(depth_m, np.float32), allow_pickle=False)


def write_depth_exr(path: Path, depth_m: NDArray[np.float32]) -> None:
    """Writes channel Z, 32-bit floats, m, NaN where unknown."""
    OpenEXR = extra_module("OpenEXR", f"{path}: writing EXR needs OpenEXR", "exr")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with atomic_path(path) as partial:
        OpenEXR.File(header, {"Z": np.ascontiguousarray(depth_m, np.float32)}).write(str(partial))


def write_image(
    path: Path, suffix: str, image: NDArray[np.uint8 | np.uint16] | NDArray[np.float32]
) -> None:
    """Writes an image as OpenCV encodes it, whole or not at all."""
    done, data = cv2.imencode(suffix, image)
    if not done:
        raise InputError(f"{path}: cannot be encoded as {suffix}; choose depth-npy")
    with atomic_path(path) as partial:
        partial.write_bytes(data.tobytes())


# Every depth format by name; disparity needs a baseline and stands apart.
WRITERS: dict[str, Callable[[Path, NDArray[np.float32]], None]] = {
    "depth-png": write_depth_png,
    "depth-npy": write_depth_npy,
    "depth-tiff": lambda path, m: write_image(path, ".tiff", np.asarray(m, np.float32)),
    "depth-exr": write_depth_exr,
}


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
    """Reads an image as (H, W) uint8 grey levels, of 16 bits the upper eight."""
    image = _checked(path)
    if image.mode == "I;16":  # Pillow would clip what does not fit eight bits
        return (np.asarray(image) >> 8).astype(np.uint8)
    return np.asarray(image.convert("L"))


def _checked(path: Path) -> PngImageFile:
    """The decoded image of a file whose check sums hold."""
    from PIL.PngImagePlugin import PngImageFile  # recordings without images need not wait for it

    data = _bytes_of(path, "a PNG image", TABLE_BYTES)
    check_png(path, data)
    with _damage_named(path):
        image = PngImageFile(io.BytesIO(data))
        image.load()
        return image


def _bytes_of(path: Path, needs: str, most_bytes: int = _MOST_BYTES) -> bytes:
    try:
        check_file(path, most_bytes)
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); needs {needs}") from error


def decoded(path: Path) -> NDArray[Any]:
    """What OpenCV decodes of a PNG or TIFF, as it is stored: it keeps 16 bits and floats.

    Returns:
        (H, W) or (H, W, C), colours as blue, green, red.

    Raises:
        InputError: an unreadable or damaged file, or more than 2^26 pixels.
    """
    kind = "PNG" if path.suffix.lower() == ".png" else "TIFF"
    data = _bytes_of(path, f"a {kind} image")
    (check_png if kind == "PNG" else _check_tiff)(path, data)
    with quiet_opencv(), refused(f"{path}: not a complete {kind} image", cv2.error, cure=_AGAIN):
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{path}: not a complete {kind} image{_AGAIN}")
    return np.asarray(image)


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Keeps OpenCV from telling of damage on the error stream: who asked gets an error."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)


def check_pixels(path: Path, width: int, height: int) -> None:
    """Refuses what declares more pixels than are read: a small file can stand for gigabytes."""
    if width * height > _MOST_READ_PIXELS:
        raise InputError(f"{path}: declares {width}x{height} pixels; at most 2^26 are read")


def _check_tiff(path: Path, data: bytes) -> None:
    """Refuses a TIFF whose first image, or a tile or strip of it, declares too many pixels."""
    with refused(f"{path}: not a complete TIFF image", KeyError, struct.error, cure=_AGAIN):
        order = {b"II": "<", b"MM": ">"}[data[:2]]
        is_big = struct.unpack_from(f"{order}H", data, 2) == (43,)
        (at,) = struct.unpack_from(f"{order}{'Q' if is_big else 'I'}", data, 8 if is_big else 4)
        (count,) = struct.unpack_from(f"{order}{'Q' if is_big else 'H'}", data, at)
        first, step, value = (at + 8, 20, 12) if is_big else (at + 2, 12, 8)
        tags: dict[int, int] = {}
        for entry in range(first, first + step * min(count, _MOST_TAGS), step):
            tag, kind = struct.unpack_from(f"{order}HH", data, entry)
            if tag in _TIFF_SIDES and kind in _TIFF_NUMBERS:
                (tags[tag],) = struct.unpack_from(
                    f"{order}{_TIFF_NUMBERS[kind]}", data, entry + value
                )
        width, height = (tags[tag] for tag in _TIFF_SIDES[:2])
    check_pixels(path, width, height)
    check_pixels(path, *(tags.get(tag, 1) for tag in _TIFF_SIDES[2:]))


def _check_exr(path: Path, data: bytes) -> None:
    """Refuses an EXR whose first image declares too many pixels, of all channels together."""
    at, found = 8, {}
    with refused(f"{path}: not a complete EXR", IndexError, ValueError, struct.error, cure=_AGAIN):
        while data[at]:
            name, after = data[at : at + 256].split(b"\0")[0], data.index(b"\0", at) + 1
            at = data.index(b"\0", after) + 1
            (size,) = struct.unpack_from("<I", data, at)
            found[name], at = data[at + 4 : at + 4 + size], at + 4 + size
        left, top, right, bottom = struct.unpack("<4i", found.get(b"dataWindow", b""))
        channels = max(1, len(found.get(b"channels", b"")) // 18)
    check_pixels(path, (right - left + 1) * channels, bottom - top + 1)


def check_png(path: Path, data: bytes) -> None:
    """Refuses a PNG file that is damaged, has lost its end, or declares too many pixels."""
    from PIL.PngImagePlugin import PngImageFile

    with _damage_named(path):
        # `Image.open` would warn of sizes by a limit of its own, and not say what is damaged
        stream = io.BytesIO(data)
        image = PngImageFile(stream)
        check_pixels(path, *image.size)
        image.verify()  # every chunk but the last, whose eight first bytes have been read
        at = stream.tell()
        if data[at - 8 : at + 4] != _END:
            raise ValueError("its last chunk is damaged")


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    damage = refused(f"{path}: not a complete PNG image", *_DAMAGE, cure="; download it again")
    with damage, warnings.catch_warnings(action="error", category=UserWarning):
        yield
