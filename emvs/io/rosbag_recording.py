"""Opens a ROS1 or ROS2 bag of events and poses, such as rpg_eccv18's (Zhou et al., ECCV 2018)."""

from __future__ import annotations

from pathlib import Path

from emvs.errors import InputError
from emvs.io.descriptor import (
    CalibrationTable,
    Descriptor,
    EventsTable,
    PosesTable,
    assembled,
)
from emvs.io.events import open_events
from emvs.io.layout_files import find_optional
from emvs.io.posed import PosedRecording

_CALIBRATIONS = ("camchain*.yaml", "calib*.yaml", "calibration*.yaml", "rig.json")
_HAND_EYE = ("hand_eye.json", "hand_eye.yaml")
_POSES = ("poses.txt", "*.tum.txt", "groundtruth.txt")


def find_bag(folder: Path) -> Path | None:
    """The one bag of a folder, if there is one."""
    return find_optional(folder, ["*.bag"], "the bag")


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
    what = Descriptor(
        name=path.stem,
        calibration=CalibrationTable(file=(calibration or path).name),
        poses=PosesTable(
            file=(poses or path).name, hand_eye=None if hand_eye is None else hand_eye.name
        ),
        events=tuple(EventsTable(file=path.name, stream=stream) for stream in streams),
    )
    return assembled(beside, what, "ROS2 bag" if path.is_dir() else "ROS1 bag")
