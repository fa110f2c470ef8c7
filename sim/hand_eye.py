"""Hand-eye calibrations: where the camera sits in the frame whose poses were recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from sim import calibration
from sim.replay import hand_eye

Array = NDArray[np.float64]


def read_hand_eye(path: Path, imu_cam: Path | None = None) -> Array:
    """Reads `T_body_cam` (4, 4), the body being what was tracked.

    Args:
        path: JSON or YAML with the key `T_body_cam`, four rows of four; or TUM-VIE's mocap-imu
            calibration (key `value0.T_imu_marker`).
        imu_cam: TUM-VIE's camera calibration, for the latter: its first event camera is taken.

    Raises:
        InputError: a file that cannot be read, a missing or impossible value, or one file without
            the other.
    """
    values = calibration.parsed(path)
    try:
        if "T_body_cam" in values:
            return calibration.matrix(values["T_body_cam"], "T_body_cam")
        value0 = values.get("value0")
        if not isinstance(value0, dict) or "T_imu_marker" not in value0:
            raise InputError("no key T_body_cam or value0.T_imu_marker: needs one of them")
        T_imu_marker = calibration.pose_of(value0["T_imu_marker"], "value0.T_imu_marker")
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if imu_cam is None:
        raise InputError(
            f"{path} says where the marker sits on the IMU, but not the camera: give the camera "
            "calibration as well (imu_cam)"
        )
    return hand_eye(T_imu_marker, calibration.read_imu_cam(imu_cam))
