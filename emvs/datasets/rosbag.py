"""Recordings in ROS bags, read and written: events, poses and `camera_info`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from eventsweep.emvs.datasets.bags import info_topic, pose_topic, topics
from eventsweep.emvs.datasets.custom import described, is_bag
from eventsweep.emvs.datasets.posed import PosedRecording, find_optional
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import open_events
from eventsweep.emvs.formats.base import Sizes
from eventsweep.emvs.formats.calibration import cameras_of_topics
from eventsweep.emvs.formats.rosbag import METADATA, SUFFIXES, RosbagWriter, bag_at, is_ros2
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory

__all__ = ["METADATA", "SUFFIXES", "RecordingBag", "bag_at", "lacks", "open_bag_recording"]

POSE_TOPIC = "/T_world_cam0"
_LENS = {"pinhole": "plumb_bob", "radtan": "plumb_bob", "kb4": "equidistant"}
_EVSLAM = tuple(f"calib_results_cam{end}" for end in (".yaml", ".txt", "_[!i]*.yaml", "_[!i]*.txt"))
_CALIBRATIONS = (*_EVSLAM, "camchain*.yaml", "calib*.yaml", "calibration*.yaml", "rig.json")
_ESVO = ("left.yaml", "right.yaml")
_HAND_EYE = ("hand_eye.json", "hand_eye.yaml")
_POSES = ("poses.txt", "*.tum.txt", "groundtruth.txt")


class RecordingBag(RosbagWriter):
    """A bag with events; `append_poses` and `append_cameras` add the rest."""

    def __init__(self, path: Path, sizes_px: Sizes) -> None:
        super().__init__(path, sizes_px)
        self._store = get_typestore(Stores.ROS1_NOETIC)

    def append_poses(self, trajectory: Trajectory) -> None:
        """Writes `T_world_cam0` as geometry_msgs/PoseStamped."""
        kind = "geometry_msgs/msg/PoseStamped"
        types = self._store.types
        topic = self._bag.add_connection(POSE_TOPIC, kind, typestore=self._store)
        rows = zip(
            trajectory.t_us, trajectory.positions_m, trajectory.quats_xyzw, strict=True
        )  # fmt: skip
        for k, (t_us, position_m, quat_xyzw) in enumerate(rows):
            pose = types["geometry_msgs/msg/Pose"](
                position=types["geometry_msgs/msg/Point"](*map(float, position_m)),
                orientation=types["geometry_msgs/msg/Quaternion"](*map(float, quat_xyzw)),
            )
            message = types[kind](header=self._header(k, int(t_us), "world"), pose=pose)
            data = self._store.serialize_ros1(message, kind)
            self._bag.write(topic, int(t_us) * 1000, data)

    def append_cameras(self, names: list[str], rig: Rig, t_us: int) -> None:
        """Writes one sensor_msgs/CameraInfo per camera; the cameras are stated relative to cam0."""
        kind = "sensor_msgs/msg/CameraInfo"
        T_first = se3.inverse(rig.T_body_cam[0])
        for name, camera, T_body_cam in zip(names, rig.cameras, rig.T_body_cam, strict=True):
            topic = self._bag.add_connection(name, kind, typestore=self._store)
            message = self._info(camera, T_first @ T_body_cam, t_us)
            self._bag.write(topic, t_us * 1000, self._store.serialize_ros1(message, kind))

    def _info(self, camera: Camera, T_cam0_cam: Any, t_us: int) -> Any:
        types = self._store.types
        terms = np.array(camera.distortion or (0.0,) * (4 if camera.model == "kb4" else 5))
        P = np.zeros((3, 4))
        P[:, :3] = camera.K
        P[:, 3] = -camera.K @ T_cam0_cam[:3, 3]
        return types["sensor_msgs/msg/CameraInfo"](
            header=self._header(0, t_us, "cam"),
            height=camera.height_px,
            width=camera.width_px,
            distortion_model=_LENS[camera.model],
            D=terms,
            K=camera.K.ravel(),
            R=T_cam0_cam[:3, :3].ravel(),
            P=P.ravel(),
            binning_x=0,
            binning_y=0,
            roi=types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
        )

    def _header(self, sequence: int, t_us: int, frame: str) -> Any:
        types = self._store.types
        seconds, rest_us = divmod(t_us, 1_000_000)
        stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest_us * 1000)
        return types["std_msgs/msg/Header"](seq=sequence, stamp=stamp, frame_id=frame)


def lacks(path: Path) -> str:
    """Why a bag can be read for its events alone; empty where it is a whole recording.

    Only what is missing altogether is reported: what is there and damaged is an error of
    `open_bag_recording`.
    """
    if not is_bag(path):
        return f"its name ends in none of {', '.join(SUFFIXES)}"
    kinds, streams = topics(path), sorted(open_events(path).streams)
    missing = [name for name in map(info_topic, streams) if name not in kinds]
    if missing and _calibrations(path, kinds, streams) == [path]:
        return f"no calibration: no topic {missing[0]}, no camera chain beside it"
    return ""


def _calibrations(path: Path, kinds: Mapping[str, str], streams: Sequence[str]) -> list[Path]:
    """The file of the calibration, or ESVO's two; the bag itself where there is none.

    EvSLAM's lies in a folder `calibration` beside the bags' own, which `camera_info` in a bag
    precedes.
    """
    what = "the calibration"
    beside = find_optional(path.parent, _CALIBRATIONS, what)
    pair = [path.parent / name for name in _ESVO]
    if beside is None and len(streams) == len(pair) and all(each.is_file() for each in pair):
        return pair
    if beside is None and any(info_topic(stream) not in kinds for stream in streams):
        beside = find_optional(path.resolve().parent.parent / "calibration", _EVSLAM, what)
    return [beside or path]


def _published_poses(path: Path) -> Path | None:
    """EvSLAM's true poses of a bag, of the left event camera."""
    bags = path.resolve().parent
    folders = (bags, bags.parent / "groundtruth", bags.parent / "gt")
    names = (f"{path.stem}.tum", f"{path.stem}_gt.txt")
    found = (folder / name for folder in folders for name in names)
    return next((file for file in found if file.is_file()), None)


def open_bag_recording(path: Path) -> PosedRecording:
    """Opens a bag with what lies beside it: calibration, hand-eye, and poses if the bag has none.

    Streams are taken in the order of their names, so that left comes before right.
    """
    beside, kinds = path.parent, topics(path)
    hand_eye = find_optional(beside, _HAND_EYE, "the hand-eye calibration")
    poses = find_optional(beside, _POSES, "the poses")
    streams = tuple(sorted(open_events(path).streams))
    if len(streams) > 64:
        raise InputError(f"{path}: {len(streams)} event topics; choose some in a recording.toml")
    topic, lacks_poses = ("", "") if poses else pose_topic(kinds, streams)
    if lacks_poses:
        poses = _published_poses(path)
    calibrations = _calibrations(path, kinds, streams)
    cameras = () if calibrations == [path] else cameras_of_topics(calibrations, streams)
    return described(
        beside,
        "ROS2 bag" if is_ros2(path) else "ROS1 bag",
        name=path.stem,
        calibration={"file": [_from(beside, each) for each in calibrations], "cameras": cameras},
        lacks=lacks_poses,
        poses=None
        if lacks_poses and poses is None
        else {
            "file": _from(beside, poses or path),
            "topic": topic,
            "hand_eye": None if hand_eye is None else hand_eye.name,
        },
        events=[{"file": path.name, "stream": stream} for stream in streams],
    )


def _from(folder: Path, file: Path) -> str:
    """A file's place as seen from a folder."""
    return file.name if file.parent == folder else str(file)
