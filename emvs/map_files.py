"""The array files of a map folder: `.npz` without pickles, checked when read."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emvs.depth.depth_map import DepthMap
from emvs.depth.inpainting import Dense
from emvs.dsi.method import file_name
from emvs.dsi.slices import Slices
from emvs.errors import DAMAGED_NPY, InputError
from emvs.geometry.camera import Camera

CURE = "run `eventsweep map` again"
_DEPTH_KEYS = (
    "depth_m", "confidence", "mask", "argmax", "rho", "t_us", "T_world_rv", "camera",
)  # fmt: skip

Arrays = Mapping[str, NDArray[Any]]


def write_depth(path: Path, depth_map: DepthMap) -> None:
    """Writes a depth map: arrays by name, the camera as JSON text."""
    arrays = {key: getattr(depth_map, key) for key in _DEPTH_KEYS if key != "camera"}
    np.savez(path, camera=json.dumps(depth_map.camera.to_json()), **arrays)


def read_depth(path: Path, method: str) -> DepthMap:
    """Reads what `write_depth` wrote.

    Raises:
        InputError: a missing or damaged file.
    """
    arrays = read_npz(path, _DEPTH_KEYS)
    camera = _camera(path, str(arrays["camera"]))
    shape = (camera.height_px, camera.width_px)
    for key, kind in (("depth_m", "f"), ("confidence", "f"), ("mask", "b"), ("argmax", "i")):
        check_array(path, key, arrays[key], kind, shape)
    check_array(path, "T_world_rv", arrays["T_world_rv"], "f", (4, 4))
    check_array(path, "rho", arrays["rho"], "f", arrays["rho"].shape[:1])
    check_array(path, "t_us", arrays["t_us"], "i", ())
    fields = {key: arrays[key] for key in _DEPTH_KEYS if key not in ("camera", "t_us")}
    return DepthMap(method=method, camera=camera, t_us=int(arrays["t_us"]), **fields)


def read_dense(path: Path, shape: tuple[int, ...]) -> Dense:
    """Reads what `emvs.depth.inpainting.write_dense` wrote.

    Args:
        path: `dense.npz` of a method.
        shape: (H, W) of its depth map.

    Raises:
        InputError: a missing or damaged file, or a pixel both measured and filled.
    """
    arrays = read_npz(path, ("depth_m", "measured", "filled"))
    for key, kind in (("depth_m", "f"), ("measured", "b"), ("filled", "b")):
        check_array(path, key, arrays[key], kind, shape)
    dense = Dense(arrays["depth_m"], arrays["measured"], arrays["filled"])
    both = int(np.count_nonzero(dense.measured & dense.filled))
    if both:
        raise InputError(f"{path}: {both} pixels are both measured and filled: {CURE}")
    return dense


def write_slices(path: Path, slices: Slices) -> None:
    """Writes one image row of every fused volume: arrays by the method's file name."""
    arrays: dict[str, Any] = {file_name(name): rows for name, rows in slices.values.items()}
    np.savez(path, row_px=slices.row_px, rho=slices.rho, **arrays)


def read_slices(path: Path, methods: Sequence[str], width_px: int) -> Slices:
    """Reads what `write_slices` wrote.

    Raises:
        InputError: a missing or damaged file.
    """
    arrays = read_npz(path, ("row_px", "rho", *map(file_name, methods)))
    check_array(path, "row_px", arrays["row_px"], "i", ())
    check_array(path, "rho", arrays["rho"], "f", arrays["rho"].shape[:1])
    for name in map(file_name, methods):
        # A method without a volume has a slice of no planes.
        planes = len(arrays["rho"]) if len(arrays[name]) else 0
        check_array(path, name, arrays[name], "f", (planes, width_px))
    values = {method: arrays[file_name(method)] for method in methods}
    return Slices(int(arrays["row_px"]), arrays["rho"], values)


def read_npz(path: Path, keys: Sequence[str]) -> Arrays:
    """Reads the named arrays.

    Raises:
        InputError: a missing or damaged file, or one without these arrays.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            return {key: file[key] for key in keys}
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file, the map is incomplete: {CURE}") from error
    except KeyError as error:
        raise InputError(f"{path}: holds no array {error}: {CURE}") from error
    except DAMAGED_NPY as error:
        raise InputError(f"{path}: cannot be read ({error}), it is damaged: {CURE}") from error


def check_array(
    path: Path, name: str, array: NDArray[Any], kind: str, shape: tuple[int, ...]
) -> None:
    """Refuses an array of another kind (`f`, `i`, `u`, `b`) or shape.

    Raises:
        InputError: what the array is, and what it must be.
    """
    if array.dtype.kind != kind or array.shape != shape:
        raise InputError(
            f"{path}: {name} is {array.dtype} {array.shape}, must be of kind {kind!r} and shape "
            f"{shape}: {CURE}"
        )


def _camera(path: Path, text: str) -> Camera:
    try:
        return Camera.from_json(json.loads(text))
    except (json.JSONDecodeError, TypeError, AttributeError, InputError) as error:
        raise InputError(f"{path}: camera cannot be read ({error}): {CURE}") from error
