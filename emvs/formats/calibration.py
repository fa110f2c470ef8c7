"""Real calibration files as rigs: Basalt JSON, Kalibr camera chains, and DSEC's `cam_to_cam`.

The body is the first camera that is taken, so `T_body_cam` of that one is the identity.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from emvs.errors import InputError, said
from emvs.geometry import se3
from emvs.geometry.camera import Camera, Model
from emvs.geometry.rig import Rig
from emvs.utils.inputs import SETTINGS_BYTES, read_text

_TERMS = {"kb4": ("k1", "k2", "k3", "k4"), "pinhole": (), "radtan4": ("k1", "k2", "p1", "p2")}
_BASALT: dict[str, tuple[Model, str]] = {"kb4": ("kb4", "kb4"), "pinhole": ("pinhole", "pinhole")}
_KALIBR: dict[str, Model] = {"equidistant": "kb4", "radtan": "radtan", "none": "pinhole"}
_LARGEST_PX = 20_000
_MOST_VALUES = 100_000
_MOST_DEPTH = 32
_MOST_LETTERS = 500
_LONG_NUMBER = re.compile(rf"[0-9_:.]{{{_MOST_LETTERS + 1}}}")
_LARGEST = 1e100


class _Entry(NamedTuple):
    """One camera of a file, with its place in a frame common to the file."""

    name: str
    camera: Camera
    T_common_cam: NDArray[np.float64]


def read_rig(path: Path, cameras: Sequence[str | int] = ()) -> Rig:
    """Reads a rig from a calibration file.

    Args:
        path: Basalt JSON (TUM-VIE; key `value0`), a Kalibr camera chain (MVSEC), DSEC's
            `cam_to_cam.yaml`, or a sequence's own `rig.json`.
        cameras: which of the file's cameras, by name (`cam0`) or number, first the one that
            becomes the body; without it the event cameras: entries 2 and 3 of a Basalt file with
            four, those of `camera_type: event` where the file says so, else all.

    Returns:
        The rig, named after the file.

    Raises:
        InputError: a file that cannot be read, or a missing or impossible value; names the key.
    """
    values = parsed(path)
    try:
        if "cameras" in values:
            return Rig.from_json(values)
        entries = _basalt(values["value0"]) if "value0" in values else _kalibr(values)
        return _rig(path.stem, _chosen(entries, values, cameras))
    except InputError as error:
        raise InputError(f"{path}: {said(error, 600)}") from error


def read_imu_cam(path: Path) -> NDArray[np.float64]:
    """Where the first event camera sits on the IMU, `T_imu_cam` (4, 4), from a Basalt JSON.

    Raises:
        InputError: a file that cannot be read, or a missing or impossible value; names the key.
    """
    values = parsed(path)
    try:
        entries = _basalt(entry_of(values, "value0", "the file", dict))
        return _chosen(entries, values, ())[0].T_common_cam
    except InputError as error:
        raise InputError(f"{path}: {said(error, 600)}") from error


def _rig(name: str, entries: list[_Entry]) -> Rig:
    T_body_common = se3.inverse(entries[0].T_common_cam)
    return Rig(
        name,
        tuple(entry.camera for entry in entries),
        tuple(T_body_common @ entry.T_common_cam for entry in entries),
        tuple(entry.name for entry in entries),
    )


def _chosen(
    entries: list[_Entry], values: dict[str, Any], cameras: Sequence[str | int]
) -> list[_Entry]:
    names = [entry.name for entry in entries]
    wanted = [f"cam{c}" if isinstance(c, int) else c for c in cameras]
    wanted = wanted or _event_cameras(names, values)
    missing = [name for name in wanted if name not in names]
    if missing:
        raise InputError(f"no camera {missing[0]}: choose from {', '.join(names)}")
    return [entries[names.index(name)] for name in wanted]


def _event_cameras(names: list[str], values: dict[str, Any]) -> list[str]:
    if "value0" in values:
        return names[2:4] if len(names) == 4 else names
    chain = values.get("intrinsics", values)
    events = [n for n in names if n in chain and chain[n].get("camera_type") == "event"]
    return events or names


def _basalt(value0: Any) -> list[_Entry]:
    intrinsics = entry_of(value0, "intrinsics", "value0", list)
    places = entry_of(value0, "T_imu_cam", "value0", list)
    sizes = entry_of(value0, "resolution", "value0", list)
    if not len(intrinsics) == len(places) == len(sizes) >= 1:
        raise InputError(
            f"value0 has {len(intrinsics)} intrinsics, {len(places)} T_imu_cam and {len(sizes)} "
            "resolutions: needs as many of each, at least one"
        )
    found = []
    for k, (entry, place, size) in enumerate(zip(intrinsics, places, sizes, strict=True)):
        key = f"value0.intrinsics[{k}]"
        kind = entry_of(entry, "camera_type", key, str)
        if kind not in _BASALT:
            raise InputError(f"{key}.camera_type is {kind!r}: needs {' or '.join(_BASALT)}")
        model, terms = _BASALT[kind]
        numbers = entry_of(entry, "intrinsics", key, dict)
        names = ("fx", "fy", "cx", "cy", *_TERMS[terms])
        given = [number_of(numbers, name, f"{key}.intrinsics") for name in names]
        camera = camera_of(size, given[:4], model, given[4:], f"value0.resolution[{k}]", key)
        found.append(_Entry(f"cam{k}", camera, pose_of(place, f"value0.T_imu_cam[{k}]")))
    return found


def _kalibr(values: dict[str, Any]) -> list[_Entry]:
    """A chain in which `T_cn_cnm1` carries points of each camera's frame into the next one's."""
    chain = values.get("intrinsics", values)
    extrinsics = values.get("extrinsics", {})
    if not isinstance(chain, dict) or "cam0" not in chain:
        raise InputError("no key cam0: needs a Kalibr camera chain, Basalt JSON or rig.json")
    found: list[_Entry] = []
    T_common_cam = np.eye(4)
    while (name := f"cam{len(found)}") in chain:
        entry = chain[name]
        if found:
            T_common_cam = T_common_cam @ se3.inverse(_link(entry, extrinsics, len(found)))
        found.append(_Entry(name, _kalibr_camera(entry, name), T_common_cam))
    return found


def _link(entry: Any, extrinsics: Any, k: int) -> NDArray[np.float64]:
    name, between = f"cam{k}", f"T_{k}{k - 1}"
    if isinstance(extrinsics, dict) and between in extrinsics:
        return matrix(extrinsics[between], f"extrinsics.{between}")
    return matrix(entry_of(entry, "T_cn_cnm1", name, list), f"{name}.T_cn_cnm1")


def _kalibr_camera(entry: Any, name: str) -> Camera:
    kind = entry_of(entry, "camera_model", name, str)
    if kind != "pinhole":
        raise InputError(f"{name}.camera_model is {kind!r}: needs pinhole")
    lens = entry_of(entry, "distortion_model", name, str)
    if lens not in _KALIBR:
        raise InputError(f"{name}.distortion_model is {lens!r}: needs {' or '.join(_KALIBR)}")
    key = "camera_matrix" if "camera_matrix" in entry else "intrinsics"
    four = numbers_of(entry_of(entry, key, name, list), 4, f"{name}.{key}")
    coefficients = entry_of(entry, "distortion_coeffs", name, list) if lens != "none" else []
    terms = numbers_of(coefficients, len(coefficients), f"{name}.distortion_coeffs")
    size = entry_of(entry, "resolution", name, list)
    return camera_of(size, four, _KALIBR[lens], terms, f"{name}.resolution", name)


def parsed(path: Path) -> dict[str, Any]:
    """The mapping that a JSON or YAML file holds.

    Raises:
        InputError: a file that cannot be read, or holds something else.
    """
    try:
        text = read_text(path, SETTINGS_BYTES)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise InputError(f"{path}: cannot read the calibration ({reason}): correct the path") from (
            error
        )
    try:
        if _LONG_NUMBER.search(text):  # YAML takes time by the square of a number's digits
            raise ValueError(f"a number of more than {_MOST_LETTERS} digits")
        values = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
        _check_plain(values)
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        reason = said(error, 120)
        raise InputError(f"{path}: not usable JSON or YAML ({reason}): correct the file") from error
    if not isinstance(values, dict):
        raise InputError(f"{path}: holds no calibration: needs Basalt JSON or Kalibr YAML")
    return values


def _check_plain(values: Any) -> None:
    """Refuses what no calibration holds, so that nothing behind this has to think of it.

    A few lines of YAML that name each other stand for more values than memory holds, so values are
    counted as often as they are meant.

    Raises:
        ValueError: too many or too deep values, or a number or a word beyond all bounds.
    """
    left, waiting = _MOST_VALUES, [(values, 0)]
    while waiting:
        value, depth = waiting.pop()
        left -= len(value) + 1 if isinstance(value, dict | list) else 0
        if left < 0 or depth > _MOST_DEPTH:
            raise ValueError(f"more than {_MOST_VALUES} values, or deeper than {_MOST_DEPTH}")
        if isinstance(value, dict):
            waiting += [(inner, depth + 1) for pair in value.items() for inner in pair]
        elif isinstance(value, list):
            waiting += [(inner, depth + 1) for inner in value]
        elif isinstance(value, str) and len(value) > _MOST_LETTERS:
            raise ValueError(f"a word of {len(value)} letters")
        elif isinstance(value, int | float) and _LARGEST < abs(value) < float("inf"):
            raise ValueError("a number beyond 1e100")


def pose_of(place: Any, key: str) -> NDArray[np.float64]:
    """A rigid motion (4, 4) from px, py, pz, qx, qy, qz, qw; a fault names `key`."""
    position = [number_of(place, name, key) for name in ("px", "py", "pz")]
    quaternion = [number_of(place, name, key) for name in ("qx", "qy", "qz", "qw")]
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1) > 1e-3:
        raise InputError(f"{key}: the quaternion's norm is {norm:.6g}: needs 1")
    return se3.from_quat_xyzw(np.array(position), np.array(quaternion) / norm)


def camera_of(
    size: Any, four: list[float], model: Model, terms: list[float], size_key: str, key: str
) -> Camera:
    """A camera from its size, fx, fy, cx, cy (px) and lens terms; a fault names `key`."""
    width, height = numbers_of(size, 2, size_key)
    if not all(1 <= n <= _LARGEST_PX and n == int(n) for n in (width, height)):
        raise InputError(f"{size_key} is {width:g}x{height:g}: needs whole numbers above 0")
    fx, fy, cx, cy = four
    if not (-width < cx < 2 * width and -height < cy < 2 * height):
        raise InputError(f"{key}: principal point ({cx:g}, {cy:g}) is far off the sensor")
    try:
        return Camera(int(width), int(height), fx, fy, cx, cy, model, tuple(terms))
    except InputError as error:
        raise InputError(f"{key}: {error}") from error


def matrix(rows: Any, key: str) -> NDArray[np.float64]:
    """A rigid motion (4, 4) from four rows of four; a fault names `key`."""
    try:
        T = np.array(rows, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{key} holds something that is not a number: needs 4x4 numbers"
        ) from error
    if T.shape != (4, 4) or not se3.is_rigid(T):
        raise InputError(f"{key} is not a rigid motion: needs a 4x4 matrix with a rotation")
    return T


def entry_of(mapping: Any, name: str, key: str, kind: type) -> Any:
    """What stands under a name, of the given type."""
    if not isinstance(mapping, dict) or name not in mapping:
        raise InputError(f"{key}.{name} is missing: add it")
    if not isinstance(mapping[name], kind):
        raise InputError(f"{key}.{name} is {mapping[name]!r:.60}: needs a {kind.__name__}")
    return mapping[name]


def number_of(mapping: Any, name: str, key: str) -> float:
    """The finite number under a name."""
    if not isinstance(mapping, dict) or name not in mapping:
        raise InputError(f"{key}.{name} is missing: add it")
    return numbers_of([mapping[name]], 1, f"{key}.{name}")[0]


def numbers_of(values: Any, count: int, key: str) -> list[float]:
    """A list of that many finite numbers."""
    plain = isinstance(values, list) and all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in values
    )
    if not plain or len(values) != count or not np.all(np.isfinite(values)):
        raise InputError(f"{key} is {values!r:.60}: needs {count} finite numbers")
    return [float(v) for v in values]
