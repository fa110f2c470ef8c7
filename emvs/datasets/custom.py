"""`recording.toml`: names the files of any recording, so that it opens like a data set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, ValidationError

from eventsweep.emvs.datasets.own_truth import TruthTable, open_truth
from eventsweep.emvs.datasets.posed import EventSource, PosedRecording, recorded_poses
from eventsweep.emvs.errors import InputError, located
from eventsweep.emvs.formats.calibration import read_imu_cam, read_rig
from eventsweep.emvs.formats.calibration_values import matrix, parsed, pose_of
from eventsweep.emvs.formats.tables.columns import ColumnMap
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.parameters import FrozenModel, TimeUs, first_fault
from eventsweep.emvs.utils.inputs import SETTINGS_BYTES, parse_toml, read_text
from eventsweep.emvs.utils.release import page

FILE_NAME = "recording.toml"

FileName = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]+$")]


class ColumnsTable(FrozenModel):
    """Addresses of the columns of a file, as `emvs.formats.tables.columns` explains them."""

    x: str = Field(min_length=1)
    y: str = Field(min_length=1)
    t: str = Field(min_length=1)
    p: str = Field(min_length=1)


class EventsTable(FrozenModel):
    """One camera's events.

    Attributes:
        file: event file or ROS2 folder, any format of `emvs.formats`.
        stream: which stream, where the file has several.
        time_offset_us: added to the file's times.
        columns: which column is what, where neither names nor values say it.
        time_unit: what its times count: `s`, `ms`, `us` or `ns`; needed with `columns`.
    """

    file: FileName
    stream: str = ""
    time_offset_us: TimeUs = 0
    columns: ColumnsTable | None = None
    time_unit: Literal["", "s", "ms", "us", "ns"] = ""

    def source(self, folder: Path) -> EventSource:
        """The events, of a file relative to a folder."""
        stated = {} if self.columns is None else self.columns.model_dump()
        is_stated = bool(stated or self.time_unit)
        columns = ColumnMap(**stated, time_unit=self.time_unit) if is_stated else None
        return EventSource(folder / self.file, self.stream, self.time_offset_us, columns)


def _as_list(value: object) -> object:
    return [value] if isinstance(value, str) else value


class CalibrationTable(FrozenModel):
    """The rig.

    Attributes:
        file: whatever `emvs.formats.calibration.read_rig` reads, or a ROS bag with `camera_info`;
            or a list of files of one camera each, in the order of the events.
        cameras: which of its cameras, in the order of the events; by default its event cameras.
    """

    file: Annotated[
        tuple[FileName, ...], Field(min_length=1, max_length=64), BeforeValidator(_as_list)
    ]
    cameras: tuple[int | str, ...] = ()


class PosesTable(FrozenModel):
    """The trajectory.

    Attributes:
        file: text `t x y z qx qy qz qw`, or a ROS bag.
        topic: the bag's topic, where it has several with poses.
        unit: of `t`, s unless a header says another; a bag says it itself.
        time_offset_us: added to the file's times.
        hand_eye: where the first camera sits on what was tracked: JSON or YAML with `T_body_cam`,
            or TUM-VIE's mocap calibration; without it the poses are the first camera's.
        imu_cam: Basalt calibration that says where the camera sits on the IMU, for the latter.
    """

    file: FileName
    topic: str = ""
    unit: Literal["s", "ms", "us", "ns"] = "s"
    time_offset_us: TimeUs = 0
    hand_eye: FileName | None = None
    imu_cam: FileName | None = None


class Descriptor(FrozenModel):
    """A whole recording."""

    name: str | None = None
    depth_range_m: tuple[float, float] | None = None
    calibration: CalibrationTable
    poses: PosesTable | None = None
    events: tuple[EventsTable, ...] = Field(min_length=1, max_length=64)
    truth: TruthTable | None = None


def read_descriptor(path: Path) -> Descriptor:
    """Reads a `recording.toml`."""
    try:
        return Descriptor(**parse_toml(read_text(path, SETTINGS_BYTES)))
    except ValidationError as error:
        where = page("datasets", "any-other-recording-recordingtoml")
        raise InputError(f"{path}: {first_fault(error)}; see {where}") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as TOML ({error}); correct it") from error


def assembled(
    folder: Path, what: Descriptor, layout: str, rig: Rig | None = None, lacks: str = ""
) -> PosedRecording:
    """Opens the recording that a descriptor describes, relative to a folder.

    Without a rig it reads the calibration that the descriptor names. `lacks` says what is missing
    where it names no poses.
    """
    rig = _rig(folder, what) if rig is None else rig
    poses: Trajectory | str = lacks or f"no table [poses] in {FILE_NAME}"
    if what.poses is not None:
        poses = _poses(folder, what.poses)
    sources = tuple(events.source(folder) for events in what.events)
    truth = None if what.truth is None else open_truth(folder, what.truth, rig, poses)
    return PosedRecording(
        path=folder,
        layout=layout,
        name=what.name or folder.resolve().name,
        rig=rig,
        poses=poses,
        sources=sources,
        truth=truth,
        depth_range_m=what.depth_range_m,
    )


def described(
    folder: Path, layout: str, rig: Rig | None = None, lacks: str = "", **tables: Any
) -> PosedRecording:
    """Opens the recording that the tables of a descriptor describe, as plain values."""
    return assembled(folder, Descriptor(**tables), layout, rig, lacks)


def _rig(folder: Path, what: Descriptor) -> Rig:
    paths = [folder / name for name in what.calibration.file]
    if len(paths) > 1 or not is_bag(paths[0]):
        return read_rig(paths, what.calibration.cameras)
    from eventsweep.emvs.datasets.bags import read_bag_rig

    return read_bag_rig(paths[0], [events.stream for events in what.events])


def _poses(folder: Path, table: PosesTable) -> Trajectory:
    """The first camera's poses."""
    poses = _stored_poses(folder / table.file, table)
    if table.hand_eye is None:
        return poses
    imu_cam = None if table.imu_cam is None else folder / table.imu_cam
    return poses.times(read_hand_eye(folder / table.hand_eye, imu_cam))


def _stored_poses(path: Path, table: PosesTable) -> Trajectory:
    if not is_bag(path):
        stated = table.unit if "unit" in table.model_fields_set else ""
        return recorded_poses(path, stated, table.time_offset_us, "set poses.unit to")
    from eventsweep.emvs.datasets.bags import read_bag_poses

    return read_bag_poses(path, table.topic, table.time_offset_us)


def is_bag(path: Path) -> bool:
    """Whether a path is a ROS1 bag, a lone file of a ROS2 bag, or the folder of one."""
    from eventsweep.emvs.formats.rosbag import bag_at

    return bag_at(path) is not None


def read_hand_eye(path: Path, imu_cam: Path | None = None) -> NDArray[np.float64]:
    """Where the first event camera sits on what was tracked, `T_tracked_cam` (4, 4).

    The file is JSON or YAML with the key `T_body_cam` (rows of four), or TUM-VIE's mocap-IMU
    calibration with `value0.T_imu_marker`, which needs its camera calibration `imu_cam` as well.
    """
    values = parsed(path)
    with located(path):
        if "T_body_cam" in values:
            return matrix(values["T_body_cam"], "T_body_cam")
        value0 = values.get("value0")
        if not isinstance(value0, dict) or "T_imu_marker" not in value0:
            raise InputError("no key T_body_cam or value0.T_imu_marker: needs one of them")
        T_imu_marker = pose_of(value0["T_imu_marker"], "value0.T_imu_marker")
    if imu_cam is None:
        raise InputError(
            f"{path} gives the marker's place on the IMU, but not the camera's: give the camera "
            "calibration as well (imu_cam)"
        )
    return se3.inverse(T_imu_marker) @ read_imu_cam(imu_cam)
