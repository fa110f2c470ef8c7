"""Tracks a whole recording, whose own poses are never read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import length_of, occupied_spans, silences, steps
from eventsweep.emvs.data.recording import Recording, events_span_us
from eventsweep.emvs.data.tables import ImuSamples
from eventsweep.emvs.datasets import opened
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.plugins.track.odometry.checkpoint import Checkpoints, State
from eventsweep.plugins.track.odometry.config import TrackConfig
from eventsweep.plugins.track.odometry.motion import Motion
from eventsweep.plugins.track.odometry.online import OnlineMap
from eventsweep.plugins.track.odometry.pose import Pose, Status, smoothed
from eventsweep.plugins.track.odometry.registration.fit import Fit
from eventsweep.plugins.track.odometry.start import Past
from eventsweep.plugins.track.odometry.tracker import END_US, Tracker
from eventsweep.plugins.track.odometry.trust import WAITS, speaks_against

_PACKET_US, _READ_US = 50_000, 200_000
_SMOOTHED_AT_ONCE = 50  # with as many after them: later ones change nothing


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
        trajectory: `T_world_body`, smoothed: a pose follows from later events, too; while the
            tracker was lost there are no poses.
        statuses: what each pose comes from.
        changes: when the status changed, and why.
        span_us: first and last time that there are events of.
        maps: how many maps were made.
        covariances: (N, 6, 6) of each pose's errors, see `Pose`.
        silent_us: how much of the time lies in long silences, which have no poses, µs.
    """

    trajectory: Trajectory
    statuses: tuple[Status, ...]
    changes: tuple[Change, ...]
    span_us: tuple[int, int]
    maps: int
    covariances: NDArray[np.float64]
    silent_us: int = 0

    @property
    def covered(self) -> float:
        """Share of the time that lies between poses at most 50 ms apart; of long silences none."""
        steps_us = np.diff(self.trajectory.t_us)
        whole_us = self.span_us[1] - self.span_us[0] - self.silent_us
        return float(steps_us[steps_us <= 50_000].sum() / whole_us)


def track(
    recording: Recording | str | Path,
    config: TrackConfig | None = None,
    *,
    first_map: DepthMap | None = None,
    T_world_body: NDArray[np.float64] | None = None,
    on_map: Callable[[OnlineMap], None] | None = None,
    on_pose: Callable[[Pose], None] | None = None,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> Tracked:
    """Finds the poses of a recording from its events and calibration alone.

    Args:
        recording: what `open_recording` gave, a recording of your own, or the path of one; its
            poses are not read.
        config: rates, sizes of maps, depth range.
        first_map: a depth map of what is seen first, in whose world the poses are; needed with one
            camera.
        T_world_body: (4, 4) where the first pose lies; by default the origin.
        on_map: called with every map that is made.
        on_pose: called with every pose as it is found, before it is smoothed.
        progress: called with `track`, milliseconds done and all.
        checkpoints: where the state is kept, and taken up from: the poses are the same.

    Returns:
        `trajectory`, the status of every pose, and when and why the status changed.

    Raises:
        InputError: no events, one camera without a first map, a gyroscope that is asked for and not
            there, or no place to begin from in all of the recording; says why.
    """
    recording = opened(recording)
    settings = TrackConfig.or_default(config)
    imu = _imu(recording) if settings.gyroscope else None
    done = _Done(on_pose)
    cameras = range(len(recording.rig))

    def events(t0_us: int, t1_us: int) -> list[Events]:
        return [recording.events(camera, t0_us, t1_us) for camera in cameras]

    ahead = _Ahead(events)
    tracker = Tracker(
        recording.rig, config, depth_range_m=recording.depth_range_m, first_map=first_map,
        T_world_body=T_world_body, past=events, on_pose=done.add, on_map=done.counting(on_map),
    )  # fmt: skip
    first_us, last_us = events_span_us(recording)
    done.changes, done.until_us = [Change(first_us, tracker.status, tracker.reason)], first_us
    kept = checkpoints.load() if checkpoints else None
    if kept is not None:
        done.restore(kept)
        tracker.restore(kept["tracker"], done.poses)
    spans = occupied_spans(recording, first_us, last_us + 1)
    rest = occupied_spans(recording, done.until_us, last_us + 1)
    for t_us, end_us in steps(rest, _PACKET_US):
        done.until_us = end_us
        turns = None if imu is None else _between(imu, t_us, end_us)
        tracker.push(ahead(t_us, end_us), end_us, turns)
        if end_us > last_us:
            tracker.finish()
        done.note(tracker)
        if checkpoints is not None and checkpoints.is_due():
            state = tracker.state()
            if state is not None:
                checkpoints.save({"tracker": state, **done.state()})
        progress("track", (end_us - first_us) // 1000, (last_us + 1 - first_us) // 1000)
    poses = done.smooth_all()
    if not poses:
        raise InputError(f"{recording.name}: tracking could not start: {tracker.reason}")
    return Tracked(
        Trajectory.from_matrices(
            [pose.t_us for pose in poses], np.stack([p.T_world_body for p in poses])
        ),
        tuple(p.status for p in poses), tuple(done.changes), (first_us, last_us), done.maps,
        np.stack([p.covariance for p in poses]), length_of(silences(spans)),
    )  # fmt: skip


class _Ahead:
    """Reads more than a packet at a time: a recording takes longer to open than to read."""

    def __init__(self, events: Past) -> None:
        self._events, self._until_us = events, 0
        self._read: Sequence[Events] = ()

    def __call__(self, t0_us: int, t1_us: int) -> list[Events]:
        """The events of every camera with `t0_us <= t < t1_us`, later than those before."""
        if t1_us > self._until_us:
            self._until_us = t0_us + _READ_US
            self._read = self._events(t0_us, self._until_us)
        return [packet.between(t0_us, t1_us) for packet in self._read]


class _Done:
    """What was found up to a time; poses are smoothed once enough others came after them."""

    def __init__(self, on_pose: Callable[[Pose], None] | None = None) -> None:
        self._on_pose = on_pose
        self.poses: list[Pose] = []
        self.changes: list[Change] = []
        self.maps = self.until_us = 0
        self._smooth = 0  # the first so many are

    def add(self, pose: Pose) -> None:
        """Takes the next pose."""
        if self._on_pose is not None:
            self._on_pose(pose)
        self.poses.append(pose)
        if len(self.poses) - self._smooth >= 2 * _SMOOTHED_AT_ONCE:
            first, last = self._smooth, self._smooth + _SMOOTHED_AT_ONCE
            better = smoothed(self.poses[first:])[:_SMOOTHED_AT_ONCE]
            self.poses[first:last] = [replace(pose, belief=None) for pose in better]
            self._smooth = last

    def smooth_all(self) -> list[Pose]:
        """All poses, when no other comes."""
        return self.poses[: self._smooth] + smoothed(self.poses[self._smooth :])

    def counting(self, on_map: Callable[[OnlineMap], None] | None) -> Callable[[OnlineMap], None]:
        """Counts every map before it is passed on."""

        def count(online: OnlineMap) -> None:
            self.maps += 1
            if on_map is not None:
                on_map(online)

        return count

    def note(self, tracker: Tracker) -> None:
        """Notes changes of status; what waited and is confirmed was right all the time."""
        for change in (Change(*each) for each in tracker.changes):
            if change.status is Status.TRACKING:
                self._confirm()
            self._append(change)
        tracker.changes.clear()

    def _append(self, change: Change) -> None:
        if change.reason or change.status is not self.changes[-1].status:
            self.changes.append(change)

    def _confirm(self) -> None:
        """Poses that waited are sure, back to where something spoke against them."""
        (*noted, last), until_us = self.changes, END_US
        later: list[Change] = []
        while last.reason and not speaks_against(last.reason):
            if last.reason in WAITS:
                self._believe(last.t_us, until_us)
                last = Change(last.t_us, Status.TRACKING, "")
            later, until_us = [last, *later], last.t_us
            *noted, last = noted
        self.changes = [*noted, last]
        for change in later:
            self._append(change)

    def _believe(self, since_us: int, until_us: int) -> None:
        """Poses of this time that were uncertain are tracking."""
        for k, pose in enumerate(self.poses):
            is_then = since_us <= pose.t_us < until_us
            if is_then and pose.status is Status.UNCERTAIN:
                self.poses[k] = replace(pose, status=Status.TRACKING)

    def state(self) -> State:
        """As plain values and arrays."""
        poses = self.poses
        return {
            "until_us": self.until_us,
            "maps": self.maps,
            "changes": [[c.t_us, c.status.value, c.reason] for c in self.changes],
            "t_us": np.array([pose.t_us for pose in poses], np.int64),
            "T_world_body": np.array([pose.T_world_body for pose in poses]).reshape(-1, 4, 4),
            "twist": np.array([pose.twist for pose in poses]).reshape(-1, 6),
            "covariance": np.array([pose.covariance for pose in poses]).reshape(-1, 6, 6),
            "status": [pose.status.value for pose in poses],
            "fit": [list(astuple(pose.fit)) for pose in poses],
            "smooth": self._smooth,
            "beliefs": [pose.belief and vars(pose.belief) for pose in poses[self._smooth :]],
        }

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        self.until_us, self.maps = state["until_us"], state["maps"]
        self.changes = [Change(t_us, Status(s), reason) for t_us, s, reason in state["changes"]]
        names = "t_us", "T_world_body", "twist", "status", "fit", "covariance"
        self.poses += [
            Pose(int(t_us), T_world_body, twist, Status(status), Fit(*fit), covariance)
            for t_us, T_world_body, twist, status, fit, covariance in zip(
                *(state[name] for name in names), strict=True
            )
        ]
        self._smooth = state["smooth"]
        for k, belief in enumerate(state["beliefs"], self._smooth):
            self.poses[k] = replace(self.poses[k], belief=belief and Motion(**belief))


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
