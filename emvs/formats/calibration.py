"""Real calibration files as rigs: Basalt JSON, Kalibr's chains, DSEC's `cam_to_cam`, OpenCV's YAML.

The body is the first camera that is taken, so `T_body_cam` of that one is the identity.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count, takewhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, said
from eventsweep.emvs.formats.calibration_values import (
    FORMATS,
    camera_of,
    entry_of,
    matrix,
    number_of,
    numbers_of,
    parsed,
    pose_of,
)
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera, Model
from eventsweep.emvs.geometry.rig import Rig

_TERMS = {"kb4": ("k1", "k2", "k3", "k4"), "pinhole": (), "radtan4": ("k1", "k2", "p1", "p2")}
_BASALT: dict[str, tuple[Model, str]] = {"kb4": ("kb4", "kb4"), "pinhole": ("pinhole", "pinhole")}
_LENSES: dict[str, Model] = {
    "plumb_bob": "radtan", "rational_polynomial": "radtan", "pinhole": "radtan",
    "equidistant": "kb4", "fisheye": "kb4",
}  # fmt: skip
_KALIBR: dict[str, Model] = {"equidistant": "kb4", "radtan": "radtan", "none": "pinhole"}


class _Entry(NamedTuple):
    """One camera of a file, with its place in a frame common to the file."""

    name: str
    camera: Camera
    T_common_cam: NDArray[np.float64]


def read_rig(path: Path, cameras: Sequence[str | int] = ()) -> Rig:
    """Reads a rig from a calibration file.

    Args:
        path: Basalt JSON (TUM-VIE; key `value0`), a Kalibr camera chain (MVSEC), DSEC's
            `cam_to_cam.yaml`, YAML of OpenCV or ROS, or a sequence's own `rig.json`.
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
        return _rig(path.stem, _chosen(_entries(values), values, cameras))
    except InputError as error:
        raise InputError(f"{path}: {said(error, 600)}") from error


def read_imu_cam(path: Path) -> NDArray[np.float64]:
    """Where the first event camera sits on the IMU, `T_imu_cam` (4, 4), from a Basalt JSON."""
    values = parsed(path)
    try:
        entries = _basalt(entry_of(values, "value0", "the file", dict))
        return _chosen(entries, values, ())[0].T_common_cam
    except InputError as error:
        raise InputError(f"{path}: {said(error, 600)}") from error


def _entries(values: dict[str, Any]) -> list[_Entry]:
    if is_opencv(values):
        return _opencv(values)
    return _basalt(values["value0"]) if "value0" in values else _kalibr(values)


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
        raise InputError(f"contains no camera: {FORMATS}")
    found: list[_Entry] = []
    T_common_cam = np.eye(4)
    while (name := f"cam{len(found)}") in chain:
        entry = chain[name]
        if found:
            T_common_cam = T_common_cam @ se3.inverse(_link(entry, extrinsics, len(found)))
        found.append(_Entry(name, kalibr_camera_of(entry, name), T_common_cam))
    return found


def _link(entry: Any, extrinsics: Any, k: int) -> NDArray[np.float64]:
    name, between = f"cam{k}", f"T_{k}{k - 1}"
    if isinstance(extrinsics, dict) and between in extrinsics:
        return matrix(extrinsics[between], f"extrinsics.{between}")
    return matrix(entry_of(entry, "T_cn_cnm1", name, list), f"{name}.T_cn_cnm1")


def kalibr_camera_of(entry: Any, name: str) -> Camera:
    """The camera that an entry of a Kalibr chain describes; a fault names `name`."""
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


def is_opencv(values: dict[str, Any]) -> bool:
    """Whether a file's values are those of OpenCV or ROS."""
    return "camera_matrix" in values or "cam0_K" in values


def _opencv(values: dict[str, Any]) -> list[_Entry]:
    """All cameras: the file's only one, or `cam0_K`, `cam0_D`, `cam0_size` and so on of each."""
    if "camera_matrix" in values:
        size = [number_of(values, name, "the file") for name in ("image_width", "image_height")]
        lens = values.get("distortion_model", "plumb_bob")
        terms = _row(values, "distortion_coefficients")
        camera = _camera(size, values, "camera_matrix", lens, terms, "image_width, image_height")
        return [_Entry("cam0", camera, np.eye(4))]
    names = takewhile(lambda name: f"{name}_K" in values, (f"cam{k}" for k in count()))
    return [_numbered(values, name) for name in names]


def _numbered(values: dict[str, Any], name: str) -> _Entry:
    size, place = _row(values, f"{name}_size"), f"{name}_T_body_cam"
    lens = entry_of(values, f"{name}_model", "the file", str)
    terms = _row(values, f"{name}_D")
    camera = _camera(size, values, f"{name}_K", lens, terms, f"{name}_size")
    T_body_cam = matrix(_table(values, place, 4).tolist(), place)
    return _Entry(name, camera, T_body_cam)


def _camera(
    size: list[float], values: dict[str, Any], key: str, lens: Any, terms: list[float], of: str
) -> Camera:
    if lens not in _LENSES:
        raise InputError(f"lens model {lens!r:.60} of {key}: needs {', '.join(_LENSES)}")
    K = _table(values, key, 3)
    if K[0, 1] or not np.array_equal(K[2], [0, 0, 1]) or K[1, 0]:
        raise InputError(
            f"{key} has skew, or a last row other than 0 0 1: not a supported camera matrix"
        )
    model, kept = _lens(_LENSES[lens], terms, key)
    four = [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])]
    return camera_of(size, four, model, kept, of, key)


def _lens(model: Model, terms: list[float], key: str) -> tuple[Model, list[float]]:
    """The lens with as few terms as say the same: none, four or five."""
    if not any(terms):
        return ("kb4", [0.0] * 4) if model == "kb4" else ("pinhole", [])
    most = 4 if model == "kb4" else 5
    if any(terms[most:]):
        raise InputError(
            f"{key}: {len(terms)} lens terms: more than {most} cannot be represented; calibrate "
            "without the rational model"
        )
    kept = terms[:most] if any(terms[4:]) else terms[:4]
    return model, kept


def _row(values: dict[str, Any], key: str) -> list[float]:
    data = entry_of(entry_of(values, key, "the file", dict), "data", key, list)
    return numbers_of(data, len(data), key)


def _table(values: dict[str, Any], key: str, size: int) -> NDArray[np.float64]:
    data = entry_of(entry_of(values, key, "the file", dict), "data", key, list)
    return np.array(numbers_of(data, size * size, key)).reshape(size, size)
