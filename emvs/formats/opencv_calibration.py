"""Calibrations as OpenCV's `FileStorage` and ROS's `camera_calibration` write them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.calibration_values import (
    camera_of,
    entry_of,
    matrix,
    number_of,
    numbers_of,
)
from eventsweep.emvs.geometry.camera import Camera, Model

_LENSES: dict[str, Model] = {
    "plumb_bob": "radtan", "rational_polynomial": "radtan", "pinhole": "radtan",
    "equidistant": "kb4", "fisheye": "kb4",
}  # fmt: skip


class OpenCVCamera(NamedTuple):
    """One camera of a file, and its place (4, 4) on the body: the identity where it is alone."""

    camera: Camera
    T_body_cam: NDArray[np.float64]


def is_opencv(values: dict[str, Any]) -> bool:
    """Whether a file's values are those of OpenCV or ROS."""
    return "camera_matrix" in values or "cam0_K" in values


def opencv_cameras(values: dict[str, Any]) -> list[OpenCVCamera]:
    """All cameras: the file's only one, or `cam0_K`, `cam0_D`, `cam0_size` and so on of each."""
    if "camera_matrix" in values:
        size = [number_of(values, name, "the file") for name in ("image_width", "image_height")]
        lens = values.get("distortion_model", "plumb_bob")
        terms = _row(values, "distortion_coefficients")
        camera = _camera(size, values, "camera_matrix", lens, terms, "image_width, image_height")
        return [OpenCVCamera(camera, np.eye(4))]
    found: list[OpenCVCamera] = []
    while f"cam{len(found)}_K" in values:
        found.append(_numbered(values, f"cam{len(found)}"))
    return found


def _numbered(values: dict[str, Any], name: str) -> OpenCVCamera:
    size, place = _row(values, f"{name}_size"), f"{name}_T_body_cam"
    lens = entry_of(values, f"{name}_model", "the file", str)
    terms = _row(values, f"{name}_D")
    camera = _camera(size, values, f"{name}_K", lens, terms, f"{name}_size")
    T_body_cam = matrix(_table(values, place, 4).tolist(), place)
    return OpenCVCamera(camera, T_body_cam)


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
