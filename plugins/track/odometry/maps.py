"""The maps that are tracked: when one is made and of which events, by how far the images moved.

A map is due once the images have moved so far that what is seen now lies at the edge of the last
one, or a while after it; it shows the newest events over which the images moved by twice as much,
or a while of them. Beside tracking maps are made in a thread of their own and taken a while later.
When depends on the times of events alone, never on how fast it was made: the poses are the same on
every machine. Who asks for a map that is not finished waits for it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.utils.runtime import thread_count
from eventsweep.emvs.windows import Window, check_poses
from eventsweep.plugins.track.odometry.checkpoint import State
from eventsweep.plugins.track.odometry.config import TrackConfig
from eventsweep.plugins.track.odometry.motion import Motion, trajectory_of
from eventsweep.plugins.track.odometry.online import OnlineMap, window_us
from eventsweep.plugins.track.odometry.stream import Arrived, Stream

Matrix = NDArray[np.float64]
_DELAY_US, _DELAY_OF_WINDOW = 120_000, 0.3
_HANDED_OVER_US = 40_000  # at the latest: whoever tracks keeps events for twice as long
_PLANES = 40, 100
_MOST_VIEW_COLUMNS = 960
_FADE = 0.8  # weight of each older map among the points that are tracked
_WINDOW_COLUMNS = 0.15  # of the image, by which it moves over a map's window
_LEAST_PX = 2.0  # what has not moved by so much shows no map


class Pace:
    """How far the images have moved, and when that is enough for a map.

    Args:
        columns: of an image.
        longest_us: a window.
        stride_us: from the end of one window to that of the next.
    """

    def __init__(self, columns: int, longest_us: int, stride_us: int) -> None:
        self._window_px = _WINDOW_COLUMNS * columns
        self._longest_us, self._stride_us = longest_us, stride_us
        self._way: deque[tuple[int, float]] = deque()
        self._middle_px, self._end_us, self._end_px = 0.0, 0, 0.0

    def add(self, t_us: int, moved_px: float) -> None:
        """Takes how far the images have moved since the last time."""
        before_px = self._way[-1][1] if self._way else 0.0
        self._way.append((t_us, before_px + moved_px))
        while self._way[0][0] < t_us - self._longest_us:
            self._way.popleft()

    def restart(self) -> None:
        """Says that what comes next begins elsewhere."""
        self._way.clear()
        self._middle_px = self._end_px = 0.0

    def begin(self) -> None:
        """Says that there is a map of all so far; the next window may reach back into it."""
        begin_us, begin_px = self._way[0]
        self._made(begin_px)
        self._end_us = min(self._end_us, begin_us + self._longest_us - self._stride_us)

    def due(self) -> tuple[int, int] | None:
        """The stretch of time of a map that is due now, µs."""
        end_us, end_px = self._way[-1]
        late = end_us - self._end_us >= self._stride_us and end_px - self._end_px >= _LEAST_PX
        if len(self._way) < 2 or not (late or end_px - self._middle_px >= self._window_px):
            return None
        before = [at for at in self._way if at[1] <= end_px - self._window_px]
        begin = before[-1] if before else self._way[0]
        self._made(begin[1])
        return begin[0], end_us

    def _made(self, begin_px: float) -> None:
        self._end_us, self._end_px = self._way[-1]
        self._middle_px = (begin_px + self._end_px) / 2

    def state(self) -> State:
        """All that decides what it says from now on."""
        return {**vars(self), "_way": [list(at) for at in self._way]}

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        vars(self).update(state)
        self._way = deque((t_us, px) for t_us, px in state["_way"])


class MapCloud:
    """Points of at most `maps` depth maps."""

    def __init__(self, maps: int) -> None:
        self._maps: deque[Matrix] = deque(maxlen=maps)
        self._added = 0

    def __len__(self) -> int:
        """Points of all maps."""
        return sum(map(len, self._maps))

    def add(self, points_world: Matrix) -> None:
        """Takes the (N, 3) points of a further map; the oldest may go for it."""
        self._maps.append(points_world)
        self._added += 1

    def replace(self, points_world: Matrix) -> None:
        """Takes a map instead of all before."""
        self._maps.clear()
        self.add(points_world)

    def state(self) -> State:
        """All points, map by map."""
        return {"maps": list(self._maps), "added": self._added}

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        self._maps.clear()
        self._maps.extend(state["maps"])
        self._added = state["added"]

    def chosen(self, most: int) -> Matrix:
        """At most so many points, at random, but the same in every run; newer maps count more."""
        points = np.concatenate(self._maps)
        if len(points) <= most:
            return points
        newest_first = enumerate(reversed(self._maps))
        shares = [np.full(len(m), _FADE**age / max(len(m), 1)) for age, m in newest_first]
        weights = np.concatenate(shares[::-1])
        rng = np.random.default_rng(self._added)
        at = rng.choice(len(points), most, replace=False, p=weights / weights.sum(), shuffle=True)
        return points[at]


def points_of(depth_map: DepthMap) -> Matrix:
    """The (N, 3) points of a depth map in the world, m."""
    rows, columns = np.nonzero(depth_map.mask)
    bearing = depth_map.camera.unproject(np.stack([columns, rows], axis=-1).astype(np.float64))
    z_m = depth_map.depth_m[rows, columns].astype(np.float64)[:, None]
    return se3.transform(depth_map.T_world_rv, np.hstack([bearing * z_m, z_m]))


@dataclass(frozen=True, eq=False)
class Made:
    """A map, and the (N, 3) points to track from it on; None where there is nothing new."""

    online: OnlineMap
    points: Matrix | None


class BackgroundMaps:
    """Gathers the points of maps that are made as tracking goes on.

    Args:
        rig: the cameras.
        config: of the maps; one method.
        depth_range_m: nearest and farthest depth where the configuration has none.
        most_events: events of each camera that a window uses at most, evenly through it; None: all.
        cloud: gathers; nobody else may use it any more.
        most_points: that are tracked.
        since_us: when the events begin that maps may show.
        alone: whether there is no thread to spare; maps are then made at once.
    """

    def __init__(
        self, rig: Rig, config: MapperConfig, cloud: MapCloud, *,
        depth_range_m: tuple[float, float] | None, most_events: int | None,
        most_points: int, since_us: int, alone: bool,
    ) -> None:  # fmt: skip
        longest_us, stride_us = window_us(config)
        columns = max(camera.width_px for camera in rig.cameras)
        self.pace, self.cloud = Pace(columns, longest_us, stride_us), cloud
        self._config, self._longest_us, self._most = config, longest_us, most_points
        self._arrived = Arrived(rig, depth_range_m, most_events=most_events)
        self._due_us, self._fed_us = 0, since_us
        self._motions: list[Motion] = []
        self._thread = None if alone else ThreadPoolExecutor(1, "mapper")
        self._coming: deque[tuple[int, Future[list[Made]]]] = deque()

    def push(
        self, streams: Sequence[Stream], t_us: int, motions: Sequence[Motion], *, at_once: bool
    ) -> None:
        """Takes motions found up to `t_us`; a map is made if the `pace` says so.

        It is taken 0.12 s later, or, where maps follow faster, before the next one; if `at_once`,
        it is waited for. The mapper gets motions, and the events of the `streams`, when a map is
        due, or once there are some.
        """
        self._motions += motions
        window_us = self.pace.due()
        if window_us is None and t_us - self._fed_us < _HANDED_OVER_US:
            return
        events = [stream.between(self._fed_us, t_us) for stream in streams]
        poses = trajectory_of(self._motions)
        self._fed_us, self._motions = t_us, []
        coming: Future[list[Made]]
        if self._thread is None:
            coming = Future()
            coming.set_result(self._made(events, t_us, poses, window_us))
        else:
            coming = self._thread.submit(self._made, events, t_us, poses, window_us)
        if window_us is not None:
            delay_us = min(_DELAY_US, round(_DELAY_OF_WINDOW * (window_us[1] - window_us[0])))
            self._due_us = max(self._due_us, t_us + delay_us * (not at_once))
        self._coming.append((self._due_us, coming))

    def state(self) -> State:
        """All that decides what it does from now on, but for the cloud, while it is idle."""
        state = {"arrived": self._arrived.state(), "pace": self.pace.state()}
        motions = [vars(motion) for motion in self._motions]
        return {**state, "due_us": self._due_us, "fed_us": self._fed_us, "motions": motions}

    def restore(self, state: State) -> None:
        """Goes on from a `state` of the same rig and settings, where nothing was pushed yet."""
        self._due_us, self._fed_us = state["due_us"], state["fed_us"]
        self._motions = [Motion(**each) for each in state["motions"]]
        self._arrived.restore(state["arrived"])
        self.pace.restore(state["pace"])

    def is_idle(self) -> bool:
        """Whether no map is under way: then nothing is left but what `state` says."""
        return all(coming.done() and not coming.result() for _, coming in self._coming)

    def due(self, t_us: int) -> list[Made]:
        """The maps that are to be taken up to `t_us`, in order; waits for them."""
        made: list[Made] = []
        while self._coming and self._coming[0][0] <= t_us:
            made += self._coming.popleft()[1].result()
        return made

    def _made(
        self, events: Sequence[Events], t_us: int, poses: Trajectory,
        window_us: tuple[int, int] | None,
    ) -> list[Made]:  # fmt: skip
        for stream, packet in zip(self._arrived.streams, events, strict=True):
            stream.push(packet)
        self._arrived.add_poses(poses)
        self._arrived.drop_before(poses.span_us[1] - self._longest_us)
        if window_us is None:
            return []
        online = self._mapped(*window_us, t_us)
        return [Made(online, self._points(online))]

    def _mapped(self, t0_us: int, t1_us: int, t_us: int) -> OnlineMap:
        window = Window(t0_us, t1_us, (t0_us + t1_us) // 2, (0,) * len(self._arrived.rig))
        result, reason = None, ""
        try:
            check_poses(self._arrived.trajectory, t0_us, t1_us, self._config)
            result = map_window(self._arrived, self._config, window=window)
        except InputError as error:
            reason = str(error)
        return OnlineMap(window, result, reason, t_us - t1_us)

    def _points(self, online: OnlineMap) -> Matrix | None:
        if online.result is None:
            return None
        for depth_map in online.result.depth_maps.values():
            self.cloud.add(points_of(depth_map))
        return self.cloud.chosen(self._most)


def background_maps(
    config: TrackConfig, arrived: Arrived, cloud: MapCloud, most_points: int, since_us: int
) -> BackgroundMaps:
    """Of the rig and the depths of what has arrived; a thread is left to who tracks."""
    settings = map_config(config, arrived)
    threads = thread_count(settings.threads)
    return BackgroundMaps(
        arrived.rig, settings.model_copy(update={"threads": max(1, threads - 1)}), cloud,
        depth_range_m=arrived.depth_range_m, most_events=arrived.most_events,
        most_points=most_points, since_us=since_us, alone=threads == 1,
    )  # fmt: skip


def map_config(config: TrackConfig, arrived: Arrived) -> MapperConfig:
    """Settings of the maps that are tracked, for the depths of what has arrived."""
    rig = arrived.rig
    settings = MapperConfig(
        methods=("Focus/H" if len(rig) > 1 else "Focus/cam0",),
        window_s=config.map_s, stride_s=1 / config.map_rate_hz,
        min_depth_m=config.min_depth_m, max_depth_m=config.max_depth_m, threads=config.threads,
    )  # fmt: skip
    planes = config.planes or planes_for(rig, depth_range_m(arrived, settings))
    most = _MOST_VIEW_COLUMNS // (1 + config.half_resolution)
    return settings.model_copy(update={"planes": planes, **small_view(rig, most)})


def planes_for(rig: Rig, range_m: tuple[float, float]) -> int:
    """Depth planes of a map: one per pixel of disparity between both ends of the range, bounded."""
    fewest, most = _PLANES
    if len(rig) < 2:
        return most
    near_m, far_m = range_m
    disparity_px = rig.cameras[0].fx_px * rig.baseline_m() * (1 / near_m - 1 / far_m)
    return min(max(math.ceil(disparity_px), fewest), most)


def small_view(rig: Rig, most_columns: int) -> dict[str, float]:
    """Settings of the view of maps, where camera 0 has more columns than that."""
    camera = rig.cameras[0]
    if camera.width_px <= most_columns:
        return {}
    scale = most_columns / camera.width_px
    height_px = round(scale * camera.height_px)
    return {
        "view_width_px": most_columns, "view_height_px": height_px,
        "view_focal_px": scale * camera.fx_px, "view_focal_y_px": scale * camera.fy_px,
    }  # fmt: skip
