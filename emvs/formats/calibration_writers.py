"""Writes rigs as Kalibr camera chains, Basalt JSON, OpenCV YAML, and our own JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.files import write_text

_KALIBR = {"kb4": "equidistant", "radtan": "radtan", "pinhole": "none"}


def write_rig_json(path: Path, rig: Rig) -> None:
    """Writes our own JSON; loses nothing."""
    write_text(path, json.dumps(rig.to_json(), indent=2) + "\n")


def write_kalibr(path: Path, rig: Rig) -> None:
    """Writes a Kalibr camera chain; loses the body frame: the first camera takes its place.

    Raises:
        InputError: a lens with a fifth term, which Kalibr does not have.
    """
    write_text(path, yaml.safe_dump(kalibr_chain(rig), sort_keys=False, default_flow_style=None))


def kalibr_chain(rig: Rig) -> dict[str, Any]:
    """The chain as plain values: `T_cn_cnm1` carries points from each camera into the next."""
    chain = {}
    for k, (camera, T_body_cam) in enumerate(zip(rig.cameras, rig.T_body_cam, strict=True)):
        entry = kalibr_camera(camera, f"cam{k}")
        if k:
            T = se3.inverse(T_body_cam) @ rig.T_body_cam[k - 1]
            entry["T_cn_cnm1"] = T.tolist()
        chain[f"cam{k}"] = entry
    return chain


def kalibr_camera(camera: Camera, name: str) -> dict[str, Any]:
    """One camera of a chain."""
    terms = [float(v) for v in camera.distortion]
    if len(terms) == 5 and terms[4]:
        raise InputError(
            f"{name}: k3 is {terms[4]:g}; Kalibr has no such coefficient: choose opencv"
        )
    return {
        "camera_model": "pinhole",
        "distortion_model": _KALIBR[camera.model],
        "distortion_coeffs": terms[:4],
        "intrinsics": [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px],
        "resolution": [camera.width_px, camera.height_px],
    }


def write_basalt(path: Path, rig: Rig) -> None:
    """Writes Basalt JSON; the body is its IMU, and names of cameras are lost.

    Raises:
        InputError: a radial-tangential lens, which Basalt's reader here does not have.
    """
    write_text(path, json.dumps(basalt(rig.cameras, rig.T_body_cam), indent=2) + "\n")


def basalt(
    cameras: tuple[Camera, ...], T_imu_cam: tuple[NDArray[np.float64], ...]
) -> dict[str, Any]:
    """A Basalt calibration as plain values."""
    return {
        "value0": {
            "T_imu_cam": [pose_values(T) for T in T_imu_cam],
            "intrinsics": [_basalt_camera(camera, k) for k, camera in enumerate(cameras)],
            "resolution": [[camera.width_px, camera.height_px] for camera in cameras],
        }
    }


def pose_values(T: NDArray[np.float64]) -> dict[str, float]:
    """A rigid motion as px, py, pz, qx, qy, qz, qw."""
    position_m, quat_xyzw = se3.to_quat_xyzw(T)
    names = ("px", "py", "pz", "qx", "qy", "qz", "qw")
    return dict(zip(names, map(float, (*position_m, *quat_xyzw)), strict=True))


def _basalt_camera(camera: Camera, k: int) -> dict[str, Any]:
    if camera.model == "radtan" and any(camera.distortion):
        raise InputError(
            f"cam{k}: radial-tangential lenses cannot be written for Basalt: choose kalibr or "
            "opencv"
        )
    kind = "pinhole" if camera.model == "radtan" else camera.model
    terms = camera.distortion if kind == "kb4" else ()
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
    values = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *terms)
    return {"camera_type": kind, "intrinsics": dict(zip(names, values, strict=False))}


def write_opencv(path: Path, rig: Rig) -> None:
    """Writes OpenCV's YAML: per camera K, D, image size, model, and T_body_cam."""
    store = cv2.FileStorage(".yml", cv2.FileStorage_WRITE + cv2.FileStorage_MEMORY)
    for k, (camera, T_body_cam) in enumerate(zip(rig.cameras, rig.T_body_cam, strict=True)):
        store.write(f"cam{k}_K", camera.K)
        store.write(f"cam{k}_D", np.array(camera.distortion or (0.0,) * 4).reshape(1, -1))
        store.write(f"cam{k}_size", np.array([[camera.width_px, camera.height_px]], np.int32))
        store.write(f"cam{k}_model", "fisheye" if camera.model == "kb4" else "pinhole")
        store.write(f"cam{k}_T_body_cam", np.ascontiguousarray(T_body_cam))
    write_text(path, store.releaseAndGetString())


WRITERS: dict[str, Callable[[Path, Rig], None]] = {
    "kalibr": write_kalibr,
    "basalt": write_basalt,
    "opencv": write_opencv,
    "rig": write_rig_json,
}
"""Every calibration format by name."""
