"""Maps while events and poses arrive: the batch mapper's windows, each once it is covered."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import Silence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.window_result import WindowResult
from eventsweep.emvs.windows import Window, check_poses
from eventsweep.plugins.track.odometry.stream import Arrived

_MOST_WAITING, _MOST_POSES = 5_000_000, 1_000_000  # events of a camera, poses


@dataclass(frozen=True, eq=False)
class OnlineMap:
    """One window of an `OnlineMapper`.

    Attributes:
        window: its stretch of time.
        result: its depth maps; None where it could not be mapped.
        reason: why it could not; empty where it could.
        latency_us: how much later than the window's end the events and poses had come, µs, that it
            waited for; `result.seconds` is what the mapping took beyond that.
    """

    window: Window
    result: WindowResult | None
    reason: str
    latency_us: int


class OnlineMapper:
    """Maps sliding windows while events and poses arrive, in any packets.

    A window is mapped once events have come up to its end and poses reach beyond it. It has the
    bits that `map_windows` makes of the same window. Memory holds no more than the windows that are
    not finished; where poses do not come, the newest window or 5 million events of each camera, and
    where events do not, a million poses. What is older is let go and counted.

    Attributes:
        dropped_events: per camera, those that were let go before poses came.
        dropped_poses: those that were let go before events came.
        skipped_windows: of which no map is returned: they lie in a long silence, or their events
            were let go.

    Args:
        rig: the cameras.
        config: `window_s`, `stride_s` and everything else of sliding windows by time.
        depth_range_m: nearest and farthest depth where the configuration has none.
        start_us: when the first window begins; by default at the first event that a pose covers.
        most_events: events of each camera that a window uses at most, evenly through it.

    Raises:
        InputError: settings that need a whole recording.
    """

    def __init__(
        self, rig: Rig, config: MapperConfig, *, depth_range_m: tuple[float, float] | None = None,
        start_us: int | None = None, most_events: int | None = None,
    ) -> None:  # fmt: skip
        _check(config)
        self._config, self._next_us = config, start_us
        self._arrived = Arrived(rig, depth_range_m, most_events=most_events)
        self._until_us: int | None = None
        self._silence = Silence()
        self.dropped_events = [0] * len(rig)
        self.dropped_poses = self.skipped_windows = 0

    @property
    def waits_for(self) -> Literal["", "events", "poses"]:
        """What has to come before a next map can be made; empty where both keep pace."""
        poses, until_us = self._arrived.poses, self._until_us
        if not any(map(len, self._arrived.streams)):
            return "events"
        if poses is None or (until_us is not None and poses.span_us[1] < until_us - 1):
            return "poses"
        return ""

    def push(
        self, events: Sequence[Events], t_us: int, poses: Trajectory | None = None
    ) -> list[OnlineMap]:
        """Takes what has come since the last call, and maps what that completes.

        Args:
            events: one per camera, those since the last call, all before `t_us`.
            t_us: up to when the events are all there, µs.
            poses: `T_world_body`, those since the last call; they may lag behind the events.

        Raises:
            InputError: events or poses out of order, or not one stream per camera.
        """
        check_packet(events, self._arrived.rig, self._until_us, t_us)
        self._until_us = t_us
        self._silence.push(packet.t_us for packet in events)
        for stream, packet in zip(self._arrived.streams, events, strict=True):
            stream.push(packet)
        if poses is not None:
            self._arrived.add_poses(poses)
        maps = list(self._completed())
        self._let_go(t_us)
        return maps

    def _completed(self) -> Iterator[OnlineMap]:
        length_us, stride_us = window_us(self._config)
        while (window := self._next_window(length_us)) is not None:
            yield self._map(window)
            self._go_to(window.t0_us + stride_us)

    def _go_to(self, next_us: int) -> None:
        self._next_us = next_us
        self._arrived.drop_before(next_us)

    def _step_over(self, next_us: int, end_us: int) -> int:
        """The first window from the next one on that ends no earlier than a time; goes to it."""
        length_us, stride_us = window_us(self._config)
        over = max(0, -((next_us + length_us - end_us) // stride_us))
        if over:
            self.skipped_windows += over
            self._go_to(next_us + over * stride_us)
        return next_us + over * stride_us

    def _let_go(self, t_us: int) -> None:
        """Keeps memory bounded where events or poses do not come."""
        length_us, _ = window_us(self._config)
        arrived, before_us = self._arrived, t_us - length_us
        borders = [s.time_of_newest(_MOST_WAITING, t_us) for s in arrived.streams]
        border_us = min(before_us, max((b for b in borders if b is not None), default=before_us))
        if any(len(s) > _MOST_WAITING for s in arrived.streams):
            for k, stream in enumerate(arrived.streams):
                self.dropped_events[k] += stream.drop_before(border_us)
            if self._next_us is not None:
                self._step_over(self._next_us, border_us + length_us)
        poses = arrived.poses
        if self._next_us is None and (first_us := arrived.first_us()) is not None:
            self._silence.end_us(first_us, t_us)  # forgets what lies before
        elif poses is not None and self._next_us is None:
            self.dropped_poses += arrived.drop_poses_before(t_us)
        if poses is not None and len(poses) > _MOST_POSES:
            self.dropped_poses += arrived.drop_poses_before(int(poses.t_us[-_MOST_POSES]))

    def _next_window(self, length_us: int) -> Window | None:
        """The next window, if it is covered."""
        poses = self._arrived.poses
        if poses is None or self._until_us is None:
            return None
        if self._next_us is None:
            self._next_us = self._first_us(poses)
        if self._next_us is None:
            return None
        end_us = self._silence.end_us(self._next_us, self._until_us + 1)
        if end_us is not None:
            self._step_over(self._next_us, end_us)
        t0_us, t1_us = self._next_us, self._next_us + length_us
        at_end = self._config.reference == "end"
        if self._until_us < t1_us or poses.span_us[1] < (t1_us if at_end else t1_us - 1):
            return None
        t_ref_us = t1_us if at_end else (t0_us + t1_us) // 2
        return Window(t0_us, t1_us, t_ref_us, (0,) * len(self._arrived.rig))

    def _first_us(self, poses: Trajectory) -> int | None:
        first_us = self._arrived.first_us()
        return None if first_us is None else max(first_us, poses.span_us[0])

    def _map(self, window: Window) -> OnlineMap:
        arrived = self._arrived
        result, reason = None, ""
        try:
            check_poses(arrived.trajectory, window.t0_us, window.t1_us, self._config)
            result = map_window(arrived, self._config, window=window)
        except InputError as error:
            reason = str(error)
        assert self._until_us is not None
        return OnlineMap(window, result, reason, self._until_us - window.t1_us)


def window_us(config: MapperConfig) -> tuple[int, int]:
    """Length and stride of sliding windows by time, µs."""
    length_s = config.window_s or 0.0
    return round(length_s * 1e6), round((config.stride_s or length_s) * 1e6)


def check_packet(events: Sequence[Events], rig: Rig, since_us: int | None, t_us: int) -> None:
    """Refuses events that are not one packet per camera, in order, `since_us <= t < t_us`."""
    if len(events) != len(rig):
        raise InputError(f"events of {len(events)} cameras: needs a packet for each of {len(rig)}")
    if since_us is not None and t_us < since_us:
        raise InputError(f"pushed up to {since_us} µs, then to {t_us} µs: push in time order")
    for name, camera, packet in zip(rig.camera_names, rig.cameras, events, strict=True):
        packet.checked(camera.width_px, camera.height_px)
        if not len(packet):
            continue
        first_us, last_us = int(packet.t_us[0]), int(packet.t_us[-1])
        if (since_us is not None and first_us < since_us) or last_us >= t_us:
            since = "any time" if since_us is None else f"{since_us} µs"
            raise InputError(
                f"camera {name}: events from {first_us} to {last_us} µs in a packet from {since} "
                f"to before {t_us} µs: push in time order, every event once"
            )


def _check(config: MapperConfig) -> None:
    if config.window_s is None or min(window_us(config)) < 1:
        raise InputError("OnlineMapper maps sliding windows by time: set window_s, at least 1 µs")
    for name in ("hot_pixels", "save_dsi", "start_s", "duration_s"):
        if getattr(config, name):
            raise InputError(
                f"{name} is set: OnlineMapper has no whole recording to apply it to; leave it out"
            )
