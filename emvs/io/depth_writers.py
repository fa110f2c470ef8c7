"""Writes a depth map as 16-bit PNG, disparity PNG, npy, TIFF or EXR."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from emvs.utils.files import atomic_path

PNG_UNIT_M = 0.001
"""A 16-bit depth PNG counts millimetres; 0 means unknown."""
_MOST_PIXELS = 1 << 28


def read_depth(path: Path) -> NDArray[np.float32]:
    """Reads a map's `depth.npz` or a npy: (H, W) z-depth in m, NaN where unknown or masked.

    Raises:
        InputError: an unreadable file, or one that is no depth map; pickles are never loaded.
    """
    try:
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as stored:
                depth_m = np.where(stored["mask"], stored["depth_m"], np.nan)
        else:
            mapped = np.load(path, mmap_mode="r", allow_pickle=False)
            if mapped.ndim != 2 or mapped.size > _MOST_PIXELS or mapped.dtype.kind not in "fiu":
                raise InputError(f"{path}: shape {mapped.shape}, {mapped.dtype}; needs (H, W) in m")
            depth_m = np.asarray(mapped)
    except InputError:
        raise
    except Exception as error:  # numpy ends in many kinds of exception on damaged files
        said = " ".join(str(error).split())[:120]
        raise InputError(f"{path}: no depth map ({said}); needs depth.npz or a npy") from error
    return np.asarray(np.where(depth_m > 0, depth_m, np.nan), np.float32)


def write_depth_png(path: Path, depth_m: NDArray[np.float32]) -> None:
    """Writes millimetres in 16 bits; loses fractions of one.

    Raises:
        InputError: depth beyond 65.535 m.
    """
    known = np.isfinite(depth_m)
    units = np.rint(np.where(known, depth_m, 0) / PNG_UNIT_M)
    if units.max(initial=0) > 65535:
        raise InputError(
            f"{path}: depth up to {np.nanmax(depth_m):g} m; millimetres in 16 bits end at "
            "65.535 m: choose depth-npy, depth-tiff or depth-exr"
        )
    _encoded(path, ".png", units.astype(np.uint16))


def write_depth_tiff(path: Path, depth_m: NDArray[np.float32]) -> None:
    """Writes 32-bit floats, m, NaN where unknown."""
    _encoded(path, ".tiff", np.asarray(depth_m, np.float32))


def write_depth_npy(path: Path, depth_m: NDArray[np.float32]) -> None:
    """Writes 32-bit floats, m, NaN where unknown."""
    with atomic_path(path) as partial, partial.open("wb") as file:
        np.save(file, np.asarray(depth_m, np.float32), allow_pickle=False)


def write_depth_exr(path: Path, depth_m: NDArray[np.float32]) -> None:
    """Writes channel Z, 32-bit floats, m, NaN where unknown.

    Raises:
        InputError: the OpenEXR package is not installed.
    """
    try:
        import OpenEXR
    except ImportError as error:
        raise InputError(f"{path}: needs the package OpenEXR: pip install OpenEXR") from error
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with atomic_path(path) as partial:
        OpenEXR.File(header, {"Z": np.ascontiguousarray(depth_m, np.float32)}).write(str(partial))


def _encoded(path: Path, suffix: str, image: NDArray[np.uint16] | NDArray[np.float32]) -> None:
    done, data = cv2.imencode(suffix, image)
    if not done:
        raise InputError(f"{path}: cannot be coded as {suffix}; choose depth-npy")
    with atomic_path(path) as partial:
        partial.write_bytes(data.tobytes())


WRITERS: dict[str, Callable[[Path, NDArray[np.float32]], None]] = {
    "depth-png": write_depth_png,
    "depth-npy": write_depth_npy,
    "depth-tiff": write_depth_tiff,
    "depth-exr": write_depth_exr,
}
"""Every depth format by name; disparity needs a baseline and stands apart."""
