"""Data sets whose files a `recording.toml` could name: TUM-VIE, VECtor and EDS.

TUM-VIE (Klenk et al., IROS 2021): two event files, Basalt calibration, poses. VECtor (Gao et al.,
RA-L 2022): the same with ROS's calibration files, poses of what was tracked. EDS (Hidalgo-Carrio
et al., CVPR 2022): one event camera, Kalibr's chain, its poses.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.image_stores import FrameCamera
from eventsweep.emvs.datasets.custom import described
from eventsweep.emvs.datasets.posed import PosedRecording, find_folder, find_one, find_optional
from eventsweep.emvs.errors import InputError, located
from eventsweep.emvs.formats.calibration import read_imu_cam, read_rig
from eventsweep.emvs.formats.calibration_values import entry_of, near_rigid, parsed
from eventsweep.emvs.formats.frame_files import image_files, read_times_us
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig

TUMVIE_LEFT = "*events_left.h5"
_TUMVIE_RIGHT = "*events_right.h5"
_CAMERAS = ("camera-calibration*.json", "calibration/camera-calibration*.json")
_MARKER = ("mocap-imu-calibration*.json", "calibration/mocap-imu-calibration*.json")
_MOCAP = ("*vi_gt_data/mocap_data.txt", "mocap_data.txt")
_VIO = ("*vi_gt_data/vio_poses.txt", "vio_poses.txt")
_TUMVIE_FRAMES = ("*vi_gt_data/{}_images", "{}_images")

VECTOR_LEFT = "*.synced.left_event.hdf5"
_VECTOR_RIGHT = "*.synced.right_event.hdf5"
_VECTOR_TRUTH = "*.synced.gt.txt"
_VECTOR_FRAMES = ("*.synced.{}_camera", "{}_camera")
_VECTOR_LENSES = ("left_event_camera_intrinsic*.yaml", "right_event_camera_intrinsic*.yaml")
# Where VECtor's sequences by hand have a marker, those of the large scale have a lidar.
_VECTOR_LARGE = ("corridors", "school", "units")
_VECTOR_TRACKED = {
    "small": ("camera_mocap_extrinsic*.yaml", "T_cam_body"),
    "large": ("camera_lidar_extrinsic*.yaml", "T_cam_lidar"),
}

EDS_EVENTS = "events.h5"
_EDS_POSES = "stamped_groundtruth.txt"
_EDS_CHAIN = "camchain*.yaml"
_EDS_CAMERA = "cam1"  # `cam0` is the frame camera behind the same beam splitter


def open_tumvie(folder: Path) -> PosedRecording:
    """Opens a sequence; mocap poses where there are any, else VIO poses of the IMU."""
    left = find_one(folder, [TUMVIE_LEFT], "the left events")
    calibration = _relative(folder, find_one(folder, _CAMERAS, "the camera calibration"))
    mocap = find_optional(folder, _MOCAP, "the mocap poses")
    file = mocap or find_optional(folder, _VIO, "the VIO poses")
    poses = None if file is None else {"file": _relative(folder, file), "unit": "us"}
    if poses and mocap is not None:
        marker = find_one(folder, _MARKER, "the marker calibration")
        poses |= {"hand_eye": _relative(folder, marker), "imu_cam": calibration}
    right = find_one(folder, [_TUMVIE_RIGHT], "the right events")
    recording = described(
        folder,
        "TUM-VIE",
        lacks=f"neither {_MOCAP[0]} nor {_VIO[0]}",
        name=left.name.removesuffix("events_left.h5").rstrip("-_") or folder.resolve().name,
        calibration={"file": calibration},
        poses=poses,
        events=[{"file": left.name}, {"file": right.name}],
    )
    recording = replace(recording, beside=partial(_tumvie_frames, folder, folder / calibration))
    if mocap is not None:
        return recording
    T_imu_cam = read_imu_cam(folder / calibration)  # VIO poses are the IMU's
    return recording.tracked_at(T_imu_cam)


def _tumvie_frames(folder: Path, calibration: Path) -> tuple[FrameCamera, ...]:
    """The frame cameras whose images are there: entries 0 and 1; stamped mid-exposure."""
    found = []
    for k, side in enumerate(("left", "right")):
        images = find_folder(folder, _TUMVIE_FRAMES, side)
        if images is None:
            continue
        rig, stamps = read_rig(calibration, ("cam2", f"cam{k}")), f"image_timestamps_{side}.txt"
        near = [images / stamps, images.parent / stamps]
        path = next((path for path in near if path.is_file()), None)
        if path is None:
            raise InputError(f"{images}: no {stamps} in or beside it; download it again")
        t_us = read_times_us(path, 1)[:, 0]
        pictures = image_files(images, "*.jpg", t_us, t_us)
        place = rig.cameras[1], rig.T_body_cam[1]
        found.append(FrameCamera(f"frame_{side}", *place, pictures))
    return tuple(found)


def open_vector(folder: Path) -> PosedRecording:
    """Opens a sequence: events of both cameras, what was tracked, and the calibration's files.

    These lie in the folder, or in one named `*calib*` in it or beside it.
    """
    left = find_one(folder, [VECTOR_LEFT], "the left events")
    lenses = calibration_folder(folder, _VECTOR_LENSES[0])
    scale = "large" if left.name.startswith(_VECTOR_LARGE) else "small"
    pattern, key = _VECTOR_TRACKED[scale]
    tracked = find_one(lenses, [pattern], "the pose of the left frame camera on the tracked body")
    joint = find_one(lenses, [f"{scale}_scale_joint_camera_extrinsic*.yaml"], "the cameras' places")
    T_cam0_tracked = _motion(tracked, "cam0", key)
    T_cam0_event = [_motion(joint, f"cam{k}", f"T_cam0_cam{k}") for k in (2, 3)]
    cameras = [read_rig(find_one(lenses, [name], "a lens")).cameras[0] for name in _VECTOR_LENSES]
    T_first = se3.inverse(T_cam0_event[0])
    poses = find_optional(folder, [_VECTOR_TRUTH], "the poses")
    right = find_one(folder, [_VECTOR_RIGHT], "the right events")
    recording = described(
        folder,
        "VECtor",
        Rig("VECtor", tuple(cameras), tuple(T_first @ T for T in T_cam0_event)),
        name=left.name.partition(".")[0],
        calibration={"file": _VECTOR_LENSES[0]},
        lacks=f"no {_VECTOR_TRUTH}",
        poses=None if poses is None else {"file": poses.name},
        events=[{"file": left.name}, {"file": right.name}],
    )
    find_frames = partial(_vector_frames, folder, lenses, joint, T_first)
    recording = replace(recording, beside=find_frames)
    return recording.tracked_at(se3.inverse(T_cam0_tracked) @ T_cam0_event[0])


def _vector_frames(
    folder: Path, lenses: Path, joint: Path, T_first: NDArray[np.float64]
) -> tuple[FrameCamera, ...]:
    """The frame cameras whose images are there, with begin and end of their exposures.

    `T_first` leads from the left one, `cam0`, to the left event camera.
    """
    found = []
    for k, side in enumerate(("left", "right")):
        images = find_folder(folder, _VECTOR_FRAMES, side)
        if images is None:
            continue
        lens = find_one(lenses, [f"{side}_regular_camera_intrinsic*.yaml"], "the lens of images")
        times_us = read_times_us(find_one(images, ["timestamp.txt"], "the times of images"), 2, "s")
        T_cam0_cam = _motion(joint, "cam1", "T_cam0_cam1") if k else np.eye(4)
        place = read_rig(lens).cameras[0], T_first @ T_cam0_cam
        pictures = image_files(images, "*.png", *times_us.T)
        found.append(FrameCamera(f"frame_{side}", *place, pictures))
    return tuple(found)


def open_eds(folder: Path) -> PosedRecording:
    """Opens a sequence: `events.h5`, poses of the event camera, and a chain of Kalibr's."""
    poses = find_optional(folder, [_EDS_POSES], "the poses")
    chain = find_one(calibration_folder(folder, _EDS_CHAIN), [_EDS_CHAIN], "the calibration")
    return described(
        folder,
        "EDS",
        read_rig(chain, (_EDS_CAMERA,)),
        calibration={"file": chain.name, "cameras": (_EDS_CAMERA,)},
        lacks=f"no {_EDS_POSES}",
        poses=None if poses is None else {"file": poses.name},
        events=[{"file": EDS_EVENTS}],
    )


def calibration_folder(folder: Path, pattern: str) -> Path:
    """The folder with a file of the calibration: the recording's, or `*calib*` in or beside it."""
    for places in ([folder], folder.glob("*calib*"), folder.resolve().parent.glob("*calib*")):
        found = sorted(place for place in places if any(place.glob(pattern)))
        if len(found) > 1:
            names = ", ".join(place.name for place in found)
            raise InputError(
                f"{folder}: several calibrations, in {names}; copy the one for this sequence "
                "into its folder"
            )
        if found:
            return found[0]
    raise InputError(
        f"{folder}: no calibration; needs {pattern} in it, or in a folder `*calib*` in it or "
        "beside it"
    )


def _motion(path: Path, camera: str, key: str) -> NDArray[np.float64]:
    """A motion (4, 4) of a file of VECtor's calibration."""
    values = parsed(path)
    with located(path):
        return near_rigid(entry_of(values, camera, "file", dict).get(key), f"{camera}.{key}")


def _relative(folder: Path, path: Path) -> str:
    return path.relative_to(folder).as_posix()
