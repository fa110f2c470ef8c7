"""Opens a ROS1 or ROS2 bag of events and poses, such as rpg_eccv18's (Zhou et al., ECCV 2018)."""

from __future__ import annotations

from pathlib import Path

from emvs.errors import InputError
from emvs.formats import open_events
from emvs.io.bag_cameras import info_topic
from emvs.io.bag_poses import pose_topic, topics
from emvs.io.descriptor import (
    CalibrationTable,
    Descriptor,
    EventsTable,
    PosesTable,
    assembled,
    is_bag,
)
from emvs.io.layout_files import find_optional
from emvs.io.posed import PosedRecording

_CALIBRATIONS = ("camchain*.yaml", "calib*.yaml", "calibration*.yaml", "rig.json")
_HAND_EYE = ("hand_eye.json", "hand_eye.yaml")
_POSES = ("poses.txt", "*.tum.txt", "groundtruth.txt")


def find_bag(folder: Path) -> Path | None:
    """The one bag of a folder, if there is one."""
    return find_optional(folder, ["*.bag"], "the bag")


def lacks(path: Path) -> str:
    """Why a bag can be read for its events alone; empty where it is a whole recording.

    Only what is not there at all is told of: what is there and damaged is an error of
    `open_bag_recording`.

    Raises:
        InputError: a damaged bag, or several files beside it for one purpose.
    """
    if not is_bag(path):
        return "its name does not end in .bag"
    kinds, streams = topics(path), sorted(open_events(path).streams)
    calibration = find_optional(path.parent, _CALIBRATIONS, "the calibration")
    missing = [name for name in map(info_topic, streams) if name not in kinds]
    if calibration is None and missing:
        return f"no calibration: no topic {missing[0]}, no camera chain beside it"
    if find_optional(path.parent, _POSES, "the poses") is None:
        return pose_topic(kinds, streams).lacks
    return ""


def open_bag_recording(path: Path) -> PosedRecording:
    """Opens a bag with what lies beside it: calibration, hand-eye, and poses if the bag has none.

    Streams are taken in the order of their names, so that left comes before right.

    Raises:
        InputError: a bag without events, poses or calibration, or with a choice of poses.
    """
    beside = path.parent
    calibration = find_optional(beside, _CALIBRATIONS, "the calibration")
    hand_eye = find_optional(beside, _HAND_EYE, "the hand-eye calibration")
    poses = find_optional(beside, _POSES, "the poses")
    streams = tuple(sorted(open_events(path).streams))
    if len(streams) > 64:
        raise InputError(f"{path}: {len(streams)} topics of events; name some in a recording.toml")
    topic = "" if poses else pose_topic(topics(path), streams).name
    what = Descriptor(
        name=path.stem,
        calibration=CalibrationTable(file=(calibration or path).name),
        poses=PosesTable(
            file=(poses or path).name,
            topic=topic,
            hand_eye=None if hand_eye is None else hand_eye.name,
        ),
        events=tuple(EventsTable(file=path.name, stream=stream) for stream in streams),
    )
    return assembled(beside, what, "ROS2 bag" if path.is_dir() else "ROS1 bag")
