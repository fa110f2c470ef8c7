"""The odometry: fed packets of events, it says where the body is, and how sure of that it is."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import Silence
from eventsweep.emvs.data.tables import ImuSamples
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.track.odometry.batches import (
    LONGEST_US,
    NOISE,
    Batch,
    Sizes,
    batch_before,
    never_fired,
    shows_edges,
    without_lone,
)
from eventsweep.plugins.track.odometry.beginning import SHORTEST_START_US, Beginning, Wait
from eventsweep.plugins.track.odometry.checkpoint import State
from eventsweep.plugins.track.odometry.config import TrackConfig
from eventsweep.plugins.track.odometry.images import Images
from eventsweep.plugins.track.odometry.maps import BackgroundMaps, MapCloud, background_maps
from eventsweep.plugins.track.odometry.motion import SIGMA_RAD_S, Gyroscope, Motion
from eventsweep.plugins.track.odometry.online import OnlineMap, check_packet
from eventsweep.plugins.track.odometry.pose import Pose, Status
from eventsweep.plugins.track.odometry.registration.fit import (
    AGREES,
    FOUND_AGAIN,
    Fit,
    Registration,
)
from eventsweep.plugins.track.odometry.registration.views import View
from eventsweep.plugins.track.odometry.start import LONGEST_START_US, Past, few
from eventsweep.plugins.track.odometry.stream import Arrived
from eventsweep.plugins.track.odometry.trust import ASTRAY, FOLLOWS, LEAST, WAITS, Confidence

Matrix = NDArray[np.float64]
_KEPT_POSES = 1024
_COAST_US = 100_000
_POSE_PX, _FASTEST_US = 2.5, 2000  # that the images move from pose to pose at most; least time
END_US = 1 << 62
_NOTED = frozenset((*WAITS, ASTRAY))
_PLAIN = "_searched", "_until_us", "_begin_us", "_next_us", "reason", "since_us"
_PARTS = "images", "arrived", "gyroscope", "cloud", "registration", "confidence"


class Tracker:
    """Finds poses from events alone.

    Packets of any size give the same poses. Memory is bounded, however long it runs. Ten seconds
    after the last event poses pause until the next one.

    Args:
        rig: the cameras; with one camera a `first_map` is needed, since one camera sees no scale.
        config: rates, sizes of maps, depth range.
        depth_range_m: nearest and farthest depth where the configuration has none.
        first_map: a depth map of what is seen first, whose world is that of the poses.
        T_world_body: (4, 4) where the first pose lies; by default the origin. Not with `first_map`.
        past: gives again what was pushed, one packet per camera of `t0_us <= t < t1_us`. With it
            poses begin with the first events, and not with the stretch of the first map.
        on_pose: called with every pose.
        on_map: called with every map.

    Raises:
        InputError: a rig of one camera without a first map.
    """

    def __init__(
        self, rig: Rig, config: TrackConfig | None = None, *,
        depth_range_m: tuple[float, float] | None = None, first_map: DepthMap | None = None,
        T_world_body: Matrix | None = None, past: Past | None = None,
        on_pose: Callable[[Pose], None] | None = None,
        on_map: Callable[[OnlineMap], None] | None = None,
    ) -> None:  # fmt: skip
        if len(rig) == 1 and first_map is None:
            raise InputError(
                "rig of 1 camera: one camera cannot determine scale; give a first_map of the scene"
            )
        self._given, self._config = rig, TrackConfig.or_default(config)
        self._images = Images(rig, half=self._config.half_resolution)
        rig, past = self._images.rig, self._images.past(past)
        self._sizes, self._on_pose, self._on_map = Sizes(rig), on_pose, on_map
        views = [View(c, T) for c, T in zip(rig.cameras, rig.T_body_cam, strict=True)]
        self._registration = Registration(views, self._sizes.levels, self._sizes.own_time)
        most_events = self._config.map_events or self._sizes.map
        self._arrived = Arrived(rig, depth_range_m, most_events=most_events)
        self._fired_us = [never_fired(camera) for camera in rig.cameras]
        self._silence, self._gyroscope = Silence(), Gyroscope()
        self._cloud = MapCloud(self._config.maps)
        self._maps: BackgroundMaps | None = None
        self._confidence = Confidence(rig, self._registration)
        self._trust = self._confidence.trust
        origin = np.eye(4) if T_world_body is None else np.asarray(T_world_body, np.float64)
        self._beginning = Beginning(
            self._arrived, self._registration, self._sizes, self._trust, self._config,
            first_map=first_map, T_world_body=origin, past=past,
        )  # fmt: skip
        self._poses: deque[Pose] = deque(maxlen=_KEPT_POSES)
        self._motion: Motion | None = None
        self._seen_from: deque[Matrix] = deque(maxlen=self._config.maps)
        self._lately: deque[tuple[int, Motion]] = deque(maxlen=LEAST)
        self.changes: deque[tuple[int, Status, str]] = deque(maxlen=_KEPT_POSES)
        self._until_us: int | None = None
        self._begin_us: int | None = None
        self._step_us = round(1e6 / self._config.rate_hz)
        self._next_us = self._searched = 0
        self.status, self.reason, self.since_us = Status.STARTING, "no events yet", 0

    def push(
        self, events: Sequence[Events], t_us: int, imu: ImuSamples | None = None
    ) -> Pose | None:
        """Takes the events since the last call, and finds the poses that they allow.

        Args:
            events: one packet per camera, all before `t_us`.
            t_us: up to when the events are all there, µs.
            imu: inertial samples since the last call, on the same clock; only the gyroscope's part
                is used, and nothing depends on there being any.

        Returns:
            The newest pose that this call found, if any.

        Raises:
            InputError: events out of order, or not one packet per camera.
        """
        check_packet(events, self._given, self._until_us, t_us)
        self._until_us, events = t_us, self._images(events)
        self._silence.push(packet.t_us for packet in events)
        for stream, packet, fired_us in zip(
            self._arrived.streams, events, self._fired_us, strict=True
        ):
            stream.push(without_lone(packet, fired_us))
        if imu is not None:
            self._gyroscope.push(imu)
        if self._begin_us is None:
            first = [int(packet.t_us[0]) for packet in events if len(packet)]
            if not first:
                return None
            self._begin_us = min(first)
            self._next_us = self._begin_us + SHORTEST_START_US
        newest = None
        while self._next_us <= t_us:
            end_us = self._silence.end_us(self._next_us, t_us + 1)
            if end_us is not None:
                self._step_over(end_us)
                continue
            newest = self._step(self._next_us) or newest
            self._next_us += self._pace_us()
        return newest

    def state(self) -> State | None:
        """All that decides what it does from now on; None while a map is under way.

        Of poses only the newest is in it.
        """
        maps = self._maps
        if maps is not None and not maps.is_idle():
            return None
        return {
            "plain": {name: getattr(self, name) for name in _PLAIN},
            "status": self.status.value,
            **{name: getattr(self, f"_{name}").state() for name in _PARTS},
            "fired_us": self._fired_us,
            "occupied_us": self._silence.spans,
            "mapper": None if maps is None else maps.state(),
            "motion": None if self._motion is None else vars(self._motion),
            "seen_from": list(self._seen_from),
            "lately": [[end_us, vars(motion)] for end_us, motion in self._lately],
        }

    def restore(self, state: State, poses: Sequence[Pose]) -> None:
        """Goes on from a `state` of the same rig and settings, before anything was pushed.

        Args:
            state: what `state` returned.
            poses: those found up to then.
        """
        for name in _PLAIN:
            setattr(self, name, state["plain"][name])
        for name in _PARTS:
            getattr(self, f"_{name}").restore(state[name])
        self.status = Status(state["status"])
        self._fired_us = state["fired_us"]
        self._silence.spans = [(first_us, last_us) for first_us, last_us in state["occupied_us"]]
        if state["mapper"] is not None:
            self._maps = self._background(0)
            self._maps.restore(state["mapper"])
        self._motion = state["motion"] and Motion(**state["motion"])
        self._seen_from.extend(state["seen_from"])
        self._lately.extend((end_us, Motion(**motion)) for end_us, motion in state["lately"])
        self._poses.extend(poses)

    def known(self) -> Trajectory:
        """The newest poses.

        Raises:
            InputError: there are none yet.
        """
        if not self._poses:
            raise InputError(f"no poses yet: {self.reason}")
        poses = np.stack([pose.T_world_body for pose in self._poses])
        return Trajectory.from_matrices([pose.t_us for pose in self._poses], poses)

    def finish(self) -> None:
        """Finds the last poses, at the end of a recording, and waits for the maps under way.

        Their batches are the newest events of ever shorter times.
        """
        end_us = self._until_us or 0
        for since_us in range(end_us - LONGEST_US, end_us, self._step_us):
            if self.status in FOLLOWS:
                self._track_last(since_us, end_us)
        self._take_maps(END_US)

    def _track_last(self, since_us: int, end_us: int) -> None:
        """Finds the pose of the last events since a time, if it is later than the last one."""
        batch = batch_before(self._arrived.streams, end_us, self._sizes.events, since_us)
        assert self._motion is not None
        if len(batch) < self._sizes.still or batch.t_us <= self._motion.t_us:
            return
        motion, fit = self._registered(batch, end_us)
        if fit.is_good(AGREES) and shows_edges(batch):
            self._found(motion, fit, self.status, filtered=True)

    def _step_over(self, end_us: int) -> None:
        """Goes to the end of a long silence: a body that nothing was seen of stands, or jumped."""
        self._next_us += -((self._next_us - end_us) // self._step_us) * self._step_us
        if self._motion is None:
            self._begin_us = end_us - 1
        else:
            self._motion = self._motion.held(self._next_us - LONGEST_US)

    def _step(self, t_us: int) -> Pose | None:
        self._take_maps(t_us)
        steps = {Status.STARTING: self._start, Status.LOST: self._search}
        pose = steps.get(self.status, self._track)(t_us)
        horizon_us = 2 * LONGEST_US if self._trust.is_confirmed else LONGEST_START_US
        for stream in self._arrived.streams:
            stream.drop_before(t_us - horizon_us)
        self._gyroscope.drop_before(t_us - horizon_us)
        return pose

    def _start(self, t_us: int) -> Pose | None:
        """Begins, if what has come up to `t_us` allows it."""
        assert self._begin_us is not None
        begun = self._beginning.at(t_us, self._begin_us)
        if isinstance(begun, Wait):
            self.reason = begun.reason
            self._next_us += begun.wait_us - self._step_us
            return None
        self._cloud.replace(begun.points)
        self._use_points(self._cloud.chosen(self._sizes.lines))
        self._maps = self._background(begun.since_us)
        found = [*begun.before, *begun.stretch]
        self._change(begun.status, self._trust.reason, found[0][0].t_us)
        for motion, fit, status in found:
            self._found(motion, fit, status)
        motions = [motion for motion, _, _ in begun.stretch]
        self._feed_mapper(t_us, motions[0], motions, is_mapped=True)
        return self._poses[-1]

    def _track(self, t_us: int) -> Pose | None:
        batch = batch_before(self._arrived.streams, t_us, self._sizes.events, 0)
        assert self._motion is not None
        if batch.t_us <= self._motion.t_us:
            return None
        if self.status not in FOLLOWS:
            self._trust.restart()
        if len(batch) < self._sizes.still:
            return self._go_on(self._motion.held(batch.t_us), Fit(), Status.STILL, t_us)
        motion, fit = self._registered(batch, t_us)
        if fit.is_good(AGREES) and shows_edges(batch):
            self._lately.append((t_us, motion))
            return self._go_on(motion, fit, self._confidence.of(motion, fit), t_us, filtered=True)
        return self._doubt(batch, fit, t_us)

    def _registered(self, batch: Batch, t_us: int) -> tuple[Motion, Fit]:
        """The motion that fits a batch, near that which the last one and the gyroscope say."""
        assert self._motion is not None
        expected = self._motion.at(batch.t_us)
        rate_rad_s = self._gyroscope.rate_at(batch.t_us, t_us)
        if rate_rad_s is not None:
            expected = expected.turning(rate_rad_s, SIGMA_RAD_S)
        if self.status not in FOLLOWS:
            return self._registration.nearby(batch.events, expected)
        if not self._trust.is_sound and batch.t_us - self.since_us > _COAST_US:
            return self._registration.nearby(batch.events, expected, judged=True)
        unsettled = self._motion.unsettled().at(batch.t_us)
        return self._registration.nearby_or_turned(batch.events, expected, unsettled)

    def _doubt(self, batch: Batch, fit: Fit, t_us: int) -> Pose | None:
        """Goes on as it moved, for a moment; then it is lost."""
        assert self._motion is not None
        reason = fit.in_words() if shows_edges(batch) else NOISE
        if self.status is not Status.COASTING:
            self._change(Status.COASTING, reason, batch.t_us)
        if batch.t_us - self.since_us < _COAST_US:
            return self._go_on(self._motion.at(batch.t_us), fit, Status.COASTING, t_us)
        self._change(Status.LOST, reason, batch.t_us)
        return None

    def _search(self, t_us: int) -> Pose | None:
        """Tries one of the places from which the map was seen, in turns."""
        batch = batch_before(self._arrived.streams, t_us, self._sizes.events, 0)
        if len(batch) < self._sizes.still or not shows_edges(batch):
            return None
        places = [self._poses[-1].T_world_body, *self._seen_from]
        place = places[self._searched % len(places)]
        self._searched += 1
        near = Motion.near(batch.t_us, place, self._beginning.reach)
        motion, fit = self._registration(batch.events, near, wide=True)
        if not fit.is_good(FOUND_AGAIN):
            return None
        self._trust.restart()
        pose = self._go_on(motion, fit, self._confidence.of(motion, fit), t_us)
        self._confidence.found_again()
        return pose

    def _go_on(
        self, motion: Motion, fit: Fit, status: Status, t_us: int, *, filtered: bool = False
    ) -> Pose:
        before = motion if self.status is Status.LOST else self._motion
        assert before is not None
        assert self._maps is not None
        if before is motion:
            self._maps.pace.restart()
        if status is not Status.COASTING:
            reason = self._trust.reason if status is Status.UNCERTAIN else ""
            self._change(status, reason, motion.t_us)
        self._feed_mapper(t_us, before, [motion])
        return self._found(motion, fit, status, filtered=filtered)

    def _found(self, motion: Motion, fit: Fit, status: Status, *, filtered: bool = False) -> Pose:
        belief = motion if filtered else None
        covariance = self._confidence.covariance(motion)
        pose = Pose(motion.t_us, motion.T_world_body, motion.twist, status, fit, covariance, belief)
        self._poses.append(pose)
        self._confidence.found(motion, status)
        self._motion = motion
        if self._on_pose is not None:
            self._on_pose(pose)
        return pose

    def _change(self, status: Status, reason: str, t_us: int) -> None:
        is_other = reason != self.reason and not _NOTED.isdisjoint((reason, self.reason))
        if status is not self.status or is_other:
            self.status, self.reason, self.since_us = status, reason, t_us
            self.changes.append((t_us, status, reason))

    def _feed_mapper(
        self, t_us: int, before: Motion, motions: Sequence[Motion], *, is_mapped: bool = False
    ) -> None:
        """Hands over the motions since the one `before`, found by what has come up to `t_us`."""
        assert self._maps is not None
        for last, motion in pairwise([before, *motions]):
            self._maps.pace.add(motion.t_us, self._registration.between_px(last, motion))
        if is_mapped:
            self._maps.pace.begin()
        at_once = not self._trust.is_confirmed
        self._maps.push(self._arrived.streams, t_us, motions, at_once=at_once)

    def _take_maps(self, t_us: int) -> None:
        """Tracks the maps from now on that are due."""
        for made in () if self._maps is None else self._maps.due(t_us):
            if made.points is not None:
                self._confidence.next_map(made.online.window)
                self._use_points(made.points)
                self._confirm()
                self._seen_from.append(self._poses[-1].T_world_body)
            if self._on_map is not None:
                self._on_map(made.online)

    def _confirm(self) -> None:
        """Judges the last poses again on a map of what came after the beginning, if it waits."""
        if self._trust.is_confirmed or self.status not in FOLLOWS:
            return
        for end_us, motion in self._lately:
            batch = batch_before(self._arrived.streams, end_us, self._sizes.events, 0)
            found, fit = self._registration.nearby(batch.events, motion)
            status = self._confidence.again(found, fit)
            self._change(status, self._trust.reason, motion.t_us)

    def _use_points(self, points: Matrix) -> None:
        self._registration.use_map(points, few(points, self._sizes))

    def _background(self, since_us: int) -> BackgroundMaps:
        most_points = self._sizes.lines
        return background_maps(self._config, self._arrived, self._cloud, most_points, since_us)

    def _pace_us(self) -> int:
        """From here to the next pose: less where the images move fast."""
        if self._motion is None or self.status not in FOLLOWS:
            return self._step_us
        wanted_us = 1e6 * _POSE_PX / max(self._registration.speed_px_s(self._motion), 1e-3)
        return round(min(self._step_us, max(wanted_us, _FASTEST_US)))
