"""Tracks a whole recording, whose own poses are never read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.tables import ImuSamples
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.odometry.config import TrackConfig
from eventsweep.emvs.odometry.online import OnlineMap
from eventsweep.emvs.odometry.tracker import Pose, Status, Tracker
from eventsweep.emvs.utils.runtime import Progress, silent

_PACKET_US = 50_000


@dataclass(frozen=True)
class Change:
    """A change of a tracker's status: when, to what, and why."""

    t_us: int
    status: Status
    reason: str


@dataclass(frozen=True, eq=False)
class Tracked:
    """A tracked recording.

    Attributes:
        trajectory: `T_world_body`; while the tracker was lost there are no poses.
        statuses: what each pose comes from.
        changes: when the status changed, and why.
        span_us: first and last time that there are events of.
        maps: how many maps were made.
    """

    trajectory: Trajectory
    statuses: tuple[Status, ...]
    changes: tuple[Change, ...]
    span_us: tuple[int, int]
    maps: int

    @property
    def covered(self) -> float:
        """Share of the time that lies between poses at most 50 ms apart."""
        steps_us = np.diff(self.trajectory.t_us)
        return float(steps_us[steps_us <= 50_000].sum() / (self.span_us[1] - self.span_us[0]))


def track(
    recording: Recording,
    config: TrackConfig | None = None,
    *,
    first_map: DepthMap | None = None,
    T_world_body: NDArray[np.float64] | None = None,
    on_map: Callable[[OnlineMap], None] | None = None,
    progress: Progress = silent,
) -> Tracked:
    """Finds the poses of a recording from its events and calibration alone.

    Args:
        recording: events and calibration; its poses are not read.
        config: rates, sizes of maps, depth range.
        first_map: a depth map of what is seen first, in whose world the poses are; needed with one
            camera.
        T_world_body: (4, 4) where the first pose lies; by default the origin.
        on_map: called with every map that is made.
        progress: called with `track`, milliseconds done and all.

    Raises:
        InputError: no events, one camera without a first map, a gyroscope that is asked for and not
            there, or no place to begin from in all of the recording; says why.
    """
    imu = _imu(recording) if TrackConfig.or_default(config).gyroscope else None
    poses: list[Pose] = []
    maps: list[int] = []

    def count(online: OnlineMap) -> None:
        maps.append(online.window.t1_us)
        if on_map is not None:
            on_map(online)

    tracker = Tracker(
        recording.rig, config, depth_range_m=recording.depth_range_m, first_map=first_map,
        T_world_body=T_world_body, on_pose=poses.append, on_map=count,
    )  # fmt: skip
    cameras = range(len(recording.rig))
    spans = [recording.event_span_us(camera) for camera in cameras]
    first_us, last_us = min(first for first, _ in spans), max(last for _, last in spans)
    changes = [Change(first_us, tracker.status, tracker.reason)]
    for t_us in range(first_us, last_us + 1, _PACKET_US):
        end_us = min(t_us + _PACKET_US, last_us + 1)
        packets = [recording.events(camera, t_us, end_us) for camera in cameras]
        tracker.push(packets, end_us, None if imu is None else _between(imu, t_us, end_us))
        if tracker.status is not changes[-1].status:
            changes.append(Change(tracker.since_us, tracker.status, tracker.reason))
        progress("track", (end_us - first_us) // 1000, (last_us + 1 - first_us) // 1000)
    if not poses:
        raise InputError(f"{recording.name}: tracking could not start: {tracker.reason}")
    return Tracked(
        Trajectory.from_matrices(
            [pose.t_us for pose in poses], np.stack([pose.T_world_body for pose in poses])
        ),
        tuple(pose.status for pose in poses), tuple(changes), (first_us, last_us), len(maps),
    )  # fmt: skip


def _imu(recording: Recording) -> ImuSamples:
    if not getattr(recording, "has_imu", False):
        raise InputError(
            f"{recording.name}: has no inertial samples for gyroscope: leave it out, poses do not "
            "need them"
        )
    samples: ImuSamples = recording.imu()  # type: ignore[attr-defined]
    return samples


def _between(imu: ImuSamples, t0_us: int, t1_us: int) -> ImuSamples:
    """The samples with `t0_us <= t < t1_us`."""
    first, last = np.searchsorted(imu.t_us, [t0_us, t1_us])
    part = slice(first, last)
    return ImuSamples(imu.t_us[part], imu.gyro_rad_s[part], imu.accel_m_s2[part], imu.T_body_imu)
