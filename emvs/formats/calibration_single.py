"""Calibrations of one camera per file: OpenCV's, ROS's, EuRoC's, and those of other programs.

A file of one camera knows its lens. Where the camera stands is known only beside another: two
files of a pair say it by `T_right_left` (ESVO), by `T_BS` (EuRoC), or by the baseline in their
projection matrices (ROS).
"""

from __future__ import annotations

from itertools import count, takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.calibration_values import (
    Entry,
    camera_of,
    entry_of,
    matrix,
    number_of,
    numbers_of,
)
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera, Model

_LENSES: dict[str, Model] = {
    "plumb_bob": "radtan", "rational_polynomial": "radtan", "pinhole": "radtan",
    "radtan": "radtan", "radial-tangential": "radtan", "radialTangential": "radtan",
    "equidistant": "kb4", "fisheye": "kb4", "none": "radtan",
}  # fmt: skip
_ALONE = "the file places no camera beside another"
_BASELINES_OFF = 0.1
"""Share by which a rectified baseline may differ from `T_right_left`'s: more is another rig."""
_CONVERT = "convert it to a Kalibr chain, or name the lens in a rig.json"
_OTHERS = {
    "an ORB-SLAM settings file": ("Camera.fx", "Camera1.fx"),
    "a camodocal (VINS) calibration": ("projection_parameters", "mirror_parameters"),
    "OpenCV's stereo calibration": ("M1", "K1", "cameraMatrix1"),
    "a Metavision calibration": ("K", "D", "img_size"),
    "an Okvis configuration": ("cameras_params", "imu_params"),
}
"""Kinds that are recognised by a key, and not read."""


def single_entries(values: dict[str, Any]) -> list[Entry] | None:
    """The cameras of a file of one of these kinds, None for another; a known other is refused."""
    if "cam0_K" in values:
        names = takewhile(lambda name: f"{name}_K" in values, (f"cam{k}" for k in count()))
        return [_numbered(values, name) for name in names]
    if "camera_matrix" in values:
        return [_ros(values)]
    if _is_message(values):
        return [_ros(_of_message(values))]
    if "T_BS" in values and "intrinsics" in values:
        return [_euroc(values)]
    if isinstance(values.get("cameras"), list):
        return _in_list(values["cameras"])
    for kind, keys in _OTHERS.items():
        if any(key in values for key in keys):
            raise InputError(f"{kind} ({', '.join(k for k in keys if k in values)}): {_CONVERT}")
    return None


def is_opencv(values: dict[str, Any]) -> bool:
    """Whether a file's values are those of OpenCV or ROS."""
    return "camera_matrix" in values or "cam0_K" in values


def unused_places(values: dict[str, Any]) -> tuple[str, ...]:
    """What a file of one camera says of another, which is of no use without that one's file."""
    said: list[str] = [key for key in ("T_right_left", "T_BS") if key in values]
    if is_opencv(values) and "projection_matrix" in values and _rectified_m(values):
        said.append(f"the baseline of {abs(_rectified_m(values)):.4g} m in projection_matrix")
    return tuple(said)


def places(paths: list[Path], files: list[dict[str, Any]]) -> list[NDArray[np.float64]]:
    """Where the cameras of several files stand, in a frame that they have in common.

    Raises:
        InputError: nothing places them, or two things that contradict each other.
    """
    if all("T_BS" in values for values in files):
        return [matrix(values["T_BS"], "T_BS") for values in files]
    links = [values["T_right_left"] for values in files if "T_right_left" in values]
    offsets_m = [_rectified_m(values) for values in files]
    if links and len(files) == 2:
        T_right_left = [matrix(link, "T_right_left") for link in links]
        if np.abs(T_right_left[0] - T_right_left[-1]).max() > 1e-6:
            raise InputError("T_right_left differs between the two files: needs the same in both")
        _check_baseline(T_right_left[0], offsets_m)
        pair = [np.eye(4), se3.inverse(T_right_left[0])]
        return pair if _right_of(paths, offsets_m) else pair[::-1]
    if any(offsets_m):
        return [_rectified_place(values) for values in files]
    raise InputError(
        "the files do not say how their cameras stand to each other: needs T_right_left, T_BS, or "
        "a baseline in projection_matrix; or give one file for all, such as a Kalibr chain"
    )


def _right_of(paths: list[Path], offsets_m: list[float]) -> int:
    """Which of two is the right camera: its projection has a baseline, or its name says it."""
    if any(offsets_m) and not all(offsets_m):
        return int(offsets_m[1] != 0)
    named = ["right" in path.stem.lower() for path in paths]
    if named[0] == named[1]:
        raise InputError("which camera is the right one? name the files left... and right...")
    return int(named[1])


def _check_baseline(T_right_left: NDArray[np.float64], offsets_m: list[float]) -> None:
    linked_m = float(np.linalg.norm(T_right_left[:3, 3]))
    rectified_m = max(map(abs, offsets_m))
    if rectified_m and abs(rectified_m - linked_m) > _BASELINES_OFF * linked_m:
        raise InputError(
            f"T_right_left is {linked_m:.4g} m long, the baseline in projection_matrix "
            f"{rectified_m:.4g} m: needs two files of one calibration, in metres"
        )


def _rectified_m(values: dict[str, Any]) -> float:
    """How far right of the first a camera stands, m, as its projection matrix says."""
    if "projection_matrix" not in values:
        return 0.0
    P = _table(values, "projection_matrix", 3, 4)
    return float(-P[0, 3] / P[0, 0]) if P[0, 0] else 0.0


def _rectified_place(values: dict[str, Any]) -> NDArray[np.float64]:
    """Where a camera stands in the common rectified frame."""
    T_rect_cam = np.eye(4)
    T_rect_cam[:3, :3] = _table(values, "rectification_matrix", 3, 3)
    T_rect_cam[0, 3] = _rectified_m(values)
    return matrix(T_rect_cam.tolist(), "rectification_matrix")


def _ros(values: dict[str, Any]) -> Entry:
    size = [number_of(values, name, "the file") for name in ("image_width", "image_height")]
    lens = values.get("distortion_model", "plumb_bob")
    terms = _row(values, "distortion_coefficients")
    camera = _camera(size, values, "camera_matrix", lens, terms, "image_width, image_height")
    return Entry("cam0", camera, _ALONE)


def _is_message(values: dict[str, Any]) -> bool:
    """Whether it is a printed `sensor_msgs/CameraInfo`, whose matrices bear a letter each."""
    named = ("height", "width", "distortion_model")
    return all(key in values for key in named) and ("K" in values or "k" in values)


def _of_message(values: dict[str, Any]) -> dict[str, Any]:
    """The same under the names of ROS's calibration files."""
    names = {
        "K": "camera_matrix", "D": "distortion_coefficients",
        "R": "rectification_matrix", "P": "projection_matrix",
    }  # fmt: skip
    found = {"image_width": values["width"], "image_height": values["height"]}
    for letter, name in names.items():
        data = values.get(letter, values.get(letter.lower()))
        if data is not None:
            found[name] = {"data": data}
    return found | {"distortion_model": values["distortion_model"] or "plumb_bob"}


def named_as_ros(values: dict[str, Any]) -> dict[str, Any]:
    """A file's values; those of a printed message under the names of ROS's calibration files."""
    return _of_message(values) if _is_message(values) else values


def _euroc(values: dict[str, Any]) -> Entry:
    """A `sensor.yaml`: `T_BS` places the camera on the body."""
    four = numbers_of(entry_of(values, "intrinsics", "the file", list), 4, "intrinsics")
    terms = entry_of(values, "distortion_coefficients", "the file", list)
    terms = numbers_of(terms, len(terms), "distortion_coefficients")
    model, kept = _kept_terms(values.get("distortion_model"), terms, "distortion_coefficients")
    camera = camera_of(values.get("resolution"), four, model, kept, "resolution", "the file")
    return Entry("cam0", camera, matrix(values["T_BS"], "T_BS"))


def _in_list(cameras: list[Any]) -> list[Entry] | None:
    """Those of aslam's ncamera and of dv-processing; None where it is a rig.json."""
    if any(isinstance(entry, dict) and "camera" in entry for entry in cameras):
        return [_aslam(entry, k) for k, entry in enumerate(cameras)]
    if any(isinstance(entry, dict) and "focalLength" in entry for entry in cameras):
        return [_dv(entry, k) for k, entry in enumerate(cameras)]
    return None


def _aslam(entry: Any, k: int) -> Entry:
    """A camera of an ncamera, which `T_B_C` places on the body."""
    key = f"cameras[{k}]"
    inner = entry_of(entry, "camera", key, dict)
    kind = entry_of(inner, "type", key, str)
    if kind != "pinhole":
        raise InputError(f"{key}.type is {kind!r:.60}: needs pinhole")
    size = [number_of(inner, name, key) for name in ("image_width", "image_height")]
    four = numbers_of(_row(inner, "intrinsics", key), 4, f"{key}.intrinsics")
    lens = entry_of(inner, "distortion", key, dict)
    parameters = lens.get("parameters")
    terms = [] if parameters is None else _row(lens, "parameters", f"{key}.distortion")
    model, kept = _kept_terms(lens.get("type", "none"), terms, f"{key}.distortion")
    camera = camera_of(size, four, model, kept, f"{key}.image_width, image_height", key)
    return Entry(f"cam{k}", camera, matrix(entry.get("T_B_C"), f"{key}.T_B_C"))


def _dv(entry: Any, k: int) -> Entry:
    """A camera of a dv-processing JSON; how several stand to each other is not read."""
    key = f"cameras[{k}]"
    size = [number_of(entry, name, key) for name in ("width", "height")]
    four = [
        number for name in ("focalLength", "principalPoint")
        for number in numbers_of(entry_of(entry, name, key, list), 2, f"{key}.{name}")
    ]  # fmt: skip
    if entry.get("skew"):
        raise InputError(f"{key}.skew is {entry['skew']!r:.60}: needs 0")
    terms = entry.get("distortion", [])
    terms = numbers_of(terms, len(terms) if isinstance(terms, list) else 0, f"{key}.distortion")
    model, kept = _kept_terms(entry.get("distortionModel", "none"), terms, f"{key}.distortion")
    camera = camera_of(size, four, model, kept, f"{key}.width, height", key)
    return Entry(f"cam{k}", camera, f"transformationToC0 of dv-processing is not read; {_CONVERT}")


def _numbered(values: dict[str, Any], name: str) -> Entry:
    size, place = _row(values, f"{name}_size"), f"{name}_T_body_cam"
    lens = entry_of(values, f"{name}_model", "the file", str)
    terms = _row(values, f"{name}_D")
    camera = _camera(size, values, f"{name}_K", lens, terms, f"{name}_size")
    T_body_cam = matrix(_table(values, place, 4, 4).tolist(), place)
    return Entry(name, camera, T_body_cam)


def _camera(
    size: list[float], values: dict[str, Any], key: str, lens: Any, terms: list[float], of: str
) -> Camera:
    model, kept = _kept_terms(lens, terms, key)
    K = _table(values, key, 3, 3)
    if K[0, 1] or not np.array_equal(K[2], [0, 0, 1]) or K[1, 0]:
        raise InputError(
            f"{key} has skew, or a last row other than 0 0 1: not a supported camera matrix"
        )
    four = [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])]
    return camera_of(size, four, model, kept, of, key)


def _kept_terms(lens: Any, terms: list[float], key: str) -> tuple[Model, list[float]]:
    """The lens with as few terms as say the same: none, four or five."""
    if not isinstance(lens, str) or lens not in _LENSES:
        raise InputError(f"lens model {lens!r:.60} of {key}: needs {', '.join(_LENSES)}")
    model = _LENSES[lens]
    if lens == "none" and any(terms):
        raise InputError(f"{key}: lens model none, but terms {terms!r:.60}: needs the model's name")
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


def _row(values: dict[str, Any], key: str, of: str = "the file") -> list[float]:
    data = entry_of(entry_of(values, key, of, dict), "data", key, list)
    return numbers_of(data, len(data), key)


def _table(values: dict[str, Any], key: str, rows: int, columns: int) -> NDArray[np.float64]:
    data = entry_of(entry_of(values, key, "the file", dict), "data", key, list)
    return np.array(numbers_of(data, rows * columns, key)).reshape(rows, columns)
