"""What has arrived and was not let go: the newest events of every camera, and poses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.track.odometry.checkpoint import State

_COLUMNS = (("x", np.uint16), ("y", np.uint16), ("t_us", np.int64), ("p", np.uint8))
_POSES = ("t_us", "positions_m", "quats_xyzw")
_ROOM = 1 << 16


class Stream:
    """Events in order of time, as one stretch of memory; what was let go takes none."""

    def __init__(self) -> None:
        self._columns: dict[str, NDArray[Any]] = {n: np.empty(_ROOM, kind) for n, kind in _COLUMNS}
        self._first = self._last = 0

    def __len__(self) -> int:
        return self._last - self._first

    def push(self, events: Events) -> None:
        """Takes events that are not older than those before."""
        if self._last + len(events) > len(self._columns["t_us"]):
            self._move(len(self) + len(events))
        for name, column in self._columns.items():
            column[self._last : self._last + len(events)] = getattr(events, name)
        self._last += len(events)

    def between(self, t0_us: int, t1_us: int, most: int | None = None) -> Events:
        """A copy of the events with `t0_us <= t < t1_us`; at most so many, evenly through them."""
        first, last = self._first + np.searchsorted(self._times(), [t0_us, t1_us], side="left")
        there = Events(*(column[first:last] for column in self._columns.values()))
        chosen = there if most is None else there.thinned(most)
        return Events(*(getattr(chosen, name).copy() for name, _ in _COLUMNS))

    def first_us(self) -> int | None:
        """When the first event that is there comes, µs."""
        return int(self._times()[0]) if len(self) else None

    def time_of_newest(self, count: int, t_us: int) -> int | None:
        """When the last `count` events before `t_us` begin, µs; None if there are not so many."""
        last = int(np.searchsorted(self._times(), t_us, side="left"))
        return int(self._times()[last - count]) if last >= count else None

    def drop_before(self, t_us: int) -> int:
        """Lets go of older events; says how many."""
        older = int(np.searchsorted(self._times(), t_us, side="left"))
        self._first += older
        return older

    def state(self) -> State:
        """The events that are there."""
        return {
            name: column[self._first : self._last].copy() for name, column in self._columns.items()
        }

    def restore(self, state: State) -> None:
        """Takes events as `state` gave them, where there are none yet."""
        self.push(Events(*(state[name] for name, _ in _COLUMNS)))

    def _times(self) -> NDArray[np.int64]:
        times: NDArray[np.int64] = self._columns["t_us"][self._first : self._last]
        return times

    def _move(self, needed: int) -> None:
        """Makes room at the end: in the same memory, unless that is too little or far too much."""
        has, room = len(self._columns["t_us"]), max(_ROOM, 3 * needed)
        stays = len(self) <= self._first and 2 * needed <= has <= 2 * room
        for name, column in self._columns.items():
            roomy = column if stays else np.empty(room, column.dtype)
            roomy[: len(self)] = column[self._first : self._last]
            self._columns[name] = roomy
        self._first, self._last = 0, len(self)


class Arrived:
    """A recording of what has arrived and was not let go: events per camera, and poses.

    Attributes:
        streams: events, one per camera.
        most_events: of each camera that `events` returns, evenly through them; None for all.
    """

    def __init__(
        self, rig: Rig, depth_range_m: tuple[float, float] | None = None, *,
        most_events: int | None = None,
    ) -> None:  # fmt: skip
        self.name, self.rig, self.depth_range_m = "online", rig, depth_range_m
        self.streams = tuple(Stream() for _ in rig.cameras)
        self.most_events = most_events
        self.poses: Trajectory | None = None

    @property
    def trajectory(self) -> Trajectory:
        """The poses that have arrived."""
        if self.poses is None:
            raise InputError("no poses have been pushed: push some first")
        return self.poses

    def first_us(self) -> int | None:
        """When the first event of any camera that is there comes, µs."""
        first = [stream.first_us() for stream in self.streams]
        return min((t_us for t_us in first if t_us is not None), default=None)

    def whole(self) -> Arrived:
        """The same streams, without poses, of which `events` returns all."""
        whole = Arrived(self.rig, self.depth_range_m)
        whole.streams = self.streams
        return whole

    def add_poses(self, poses: Trajectory) -> None:
        """Takes further poses.

        Raises:
            InputError: poses that are not later than those before.
        """
        if self.poses is None:
            self.poses = poses
            return
        parts = (self.poses, poses)
        self.poses = Trajectory(*(np.concatenate([getattr(p, n) for p in parts]) for n in _POSES))

    def drop_before(self, t_us: int) -> None:
        """Lets go of what is older, but for the pose that the time lies behind."""
        for stream in self.streams:
            stream.drop_before(t_us)
        self.drop_poses_before(t_us)

    def drop_poses_before(self, t_us: int) -> int:
        """Lets go of poses but for the one that the time lies behind; says of how many."""
        p = self.poses
        k = 0 if p is None else max(int(np.searchsorted(p.t_us, t_us, side="right")) - 1, 0)
        if p is not None and k:
            self.poses = Trajectory(p.t_us[k:], p.positions_m[k:], p.quats_xyzw[k:])
        return k

    def state(self) -> State:
        """All that is there."""
        poses = self.poses and {name: getattr(self.poses, name) for name in _POSES}
        return {"streams": [stream.state() for stream in self.streams], "poses": poses}

    def restore(self, state: State) -> None:
        """Takes what `state` gave, where nothing has arrived yet."""
        for stream, kept in zip(self.streams, state["streams"], strict=True):
            stream.restore(kept)
        poses = state["poses"]
        self.poses = poses and Trajectory(*(poses[name] for name in _POSES))

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """Times of a camera's first and last event that are there, µs."""
        events = self.streams[camera].between(-(1 << 62), 1 << 62)
        if not len(events):
            raise InputError(f"camera {self.rig.camera_names[camera]} has sent no events")
        return int(events.t_us[0]), int(events.t_us[-1])

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`."""
        return self.streams[camera].between(t0_us, t1_us, self.most_events)

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """No image: only events arrive."""
        del camera, t_us
        return None
