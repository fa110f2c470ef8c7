"""What a mapper needs of a recording, whatever its format."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.plugins import TRACKERS, points


class Recording(Protocol):
    """Calibrated event streams, posed or not, that are read lazily, by time slice."""

    @property
    def name(self) -> str:
        """Name of the recording."""

    @property
    def rig(self) -> Rig:
        """The cameras and where they sit on the body."""

    @property
    def trajectory(self) -> Trajectory:
        """`T_world_body` over time.

        Raises:
            InputError: nobody knows it; only what needs poses asks for it.
        """

    @property
    def depth_range_m(self) -> tuple[float, float] | None:
        """Nearest and farthest depth, m, if known."""

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """First and last instant of the recording, or of its events where no more is known, µs."""

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`."""

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """(H, W) intensity image of a camera nearest to a time, for people to look at, if any."""


def summary(recording: Recording) -> str:
    """A recording's name, cameras and poses in one line, without reading its events."""
    if not has_poses(recording):
        return f"{recording.name!r}, {recording.rig.sizes()}, no poses"
    first_us, last_us = recording.trajectory.span_us
    return (
        f"{recording.name!r}, {recording.rig.sizes()}, {len(recording.trajectory)} poses from "
        f"{first_us} to {last_us} µs"
    )


def has_poses(recording: Recording) -> bool:
    """Whether anybody knows where the recording's cameras were."""
    try:
        return len(recording.trajectory) > 0
    except InputError:
        return False


def no_poses(where: object, lacks: str, rig: Rig) -> InputError:
    """What a recording without poses says to whom asks for them.

    Args:
        where: file or folder.
        lacks: what is not there.
        rig: events alone give the poses of two cameras, but not those of one.
    """
    found = (
        "the trajectory.txt that `eventsweep track` writes"
        if len(rig) > 1 and points(TRACKERS)
        else ""
    )
    return InputError(
        f"{where}: has no poses ({lacks}): name {found or 'a file of them'} as poses.file in a "
        "recording.toml"
    )


def events_span_us(recording: Recording) -> tuple[int, int]:
    """First and last instant of the events of all cameras, µs."""
    spans = [recording.event_span_us(camera) for camera in range(len(recording.rig))]
    return min(first for first, _ in spans), max(last for _, last in spans)


class DerivedRecording:
    """A recording made from another: all is as it is there, but for what a subclass changes."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.recording!r})"

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.recording.name

    @property
    def rig(self) -> Rig:
        """The cameras and where they sit on the body."""
        return self.recording.rig

    @property
    def trajectory(self) -> Trajectory:
        """`T_world_body` over time."""
        return self.recording.trajectory

    @property
    def depth_range_m(self) -> tuple[float, float] | None:
        """Nearest and farthest depth, m, if known."""
        return self.recording.depth_range_m

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """First and last instant, µs: windows do not move because of what was changed."""
        return self.recording.event_span_us(camera)

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`."""
        return self.recording.events(camera, t0_us, t1_us)

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """(H, W) intensity image of a camera nearest to a time, if any."""
        return self.recording.frame(camera, t_us)
