"""Calibrations of one camera, of a pair and of chains, as other programs write them."""

import copy
import json

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry import se3

TURN = se3.from_rotation(Rotation.from_euler("xyz", (2, -3, 5), degrees=True), (-0.1, 0.004, 0.002))


def table(values, rows=1):
    values = np.asarray(values, float)
    return {"rows": rows, "cols": values.size // rows, "data": values.ravel().tolist()}


def chain(count=3):
    camera = {
        "camera_model": "pinhole", "distortion_model": "radtan", "resolution": [64, 48],
        "distortion_coeffs": [-0.1, 0.05, 0.001, 0.002], "intrinsics": [50.0, 51.0, 32.0, 24.0],
    }  # fmt: skip
    return {f"cam{k}": copy.deepcopy(camera) for k in range(count)}


def lens_of_ros(T_right_left=None, baseline_m=0.0, **more):
    K, P = np.array([[50.0, 0, 32], [0, 51, 24], [0, 0, 1]]), np.zeros((3, 4))
    P[:, :3], P[0, 3] = K, -50.0 * baseline_m
    values = {
        "image_width": 64, "image_height": 48, "camera_matrix": table(K, 3),
        "distortion_model": "plumb_bob", "distortion_coefficients": table([-0.1, 0.01, 0, 0]),
        "rectification_matrix": table(np.eye(3), 3), "projection_matrix": table(P, 3),
    }  # fmt: skip
    if T_right_left is not None:
        values["T_right_left"] = table(T_right_left[:3], 3)
    return values | more


def euroc(T_BS):
    return {
        "sensor_type": "camera", "T_BS": table(T_BS, 4), "resolution": [64, 48],
        "camera_model": "pinhole", "intrinsics": [50.0, 51.0, 32.0, 24.0],
        "distortion_model": "radial-tangential", "distortion_coefficients": [-0.1, 0.01, 0, 0],
    }  # fmt: skip


def aslam(*places):
    return {
        "label": "rig", "cameras": [
            {"camera": {
                "image_height": 48, "image_width": 64, "type": "pinhole",
                "intrinsics": table([50.0, 51.0, 32.0, 24.0]),
                "distortion": {"type": "equidistant", "parameters": table([-0.1, -0.04, 0.01, 0])},
            }, "T_B_C": table(T, 4)} for T in places
        ],
    }  # fmt: skip


def dv(count=1):
    one = {
        "name": "DVX", "width": 64, "height": 48, "skew": 0, "focalLength": [50, 51],
        "principalPoint": [32, 24], "distortion": [-0.1, 0.01, 0, 0, 0],
        "distortionModel": "radialTangential", "transformationToC0": [0.0] * 16,
    }  # fmt: skip
    return {"cameras": [one] * count}


def written(path, values):
    text = json.dumps(values) if path.suffix == ".json" else yaml.safe_dump(values)
    path.write_text(text, encoding="utf-8")
    return path
