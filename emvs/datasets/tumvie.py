"""Opens TUM-VIE (Klenk et al., IROS 2021): two event files, Basalt calibration, poses."""

from __future__ import annotations

from pathlib import Path

from eventsweep.emvs.datasets.custom import (
    CalibrationTable,
    Descriptor,
    EventsTable,
    PosesTable,
    assembled,
)
from eventsweep.emvs.datasets.files import find_one, find_optional
from eventsweep.emvs.datasets.posed import PosedRecording
from eventsweep.emvs.errors import InputError

LEFT = "*events_left.h5"
_RIGHT = "*events_right.h5"
_CAMERAS = ("camera-calibration*.json", "calibration/camera-calibration*.json")
_MARKER = ("mocap-imu-calibration*.json", "calibration/mocap-imu-calibration*.json")
_MOCAP = ("*vi_gt_data/mocap_data.txt", "mocap_data.txt")
_VIO = ("*vi_gt_data/vio_poses.txt", "vio_poses.txt")


def open_tumvie(folder: Path) -> PosedRecording:
    """Opens a sequence; mocap poses where there are any, else VIO poses of the IMU."""
    left = find_one(folder, [LEFT], "the left events")
    calibration = _relative(folder, find_one(folder, _CAMERAS, "the camera calibration"))
    mocap = find_optional(folder, _MOCAP, "the mocap poses")
    vio = find_optional(folder, _VIO, "the VIO poses")
    poses = mocap or vio
    if poses is None:
        raise InputError(f"{folder}: lacks poses; needs {_MOCAP[0]} or {_VIO[0]}")
    hand_eye = None
    if mocap is not None:
        hand_eye = _relative(folder, find_one(folder, _MARKER, "the marker calibration"))
    what = Descriptor(
        name=left.name.removesuffix("events_left.h5").rstrip("-_") or folder.resolve().name,
        calibration=CalibrationTable(file=calibration),
        poses=PosesTable(
            file=_relative(folder, poses),
            unit="us",
            hand_eye=hand_eye,
            imu_cam=None if hand_eye is None else calibration,
        ),
        events=(
            EventsTable(file=left.name),
            EventsTable(file=find_one(folder, [_RIGHT], "the right events").name),
        ),
    )
    recording = assembled(folder, what, "TUM-VIE")
    return recording if mocap is not None else _from_imu(recording, folder / calibration)


def _from_imu(recording: PosedRecording, calibration: Path) -> PosedRecording:
    """VIO poses are the IMU's: carries them to the left event camera."""
    from dataclasses import replace

    from eventsweep.emvs.formats.calibration import read_imu_cam

    return replace(recording, trajectory=recording.trajectory.times(read_imu_cam(calibration)))


def _relative(folder: Path, path: Path) -> str:
    return path.relative_to(folder).as_posix()
