"""Which events make a map: one window, or a plan of sliding windows over a recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.occupied import Span, occupied_spans, steps
from eventsweep.emvs.data.recording import Recording, events_span_us
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.runtime import Progress, silent

MOST_WINDOWS = 100_000
Times = NDArray[np.int64]
_USUAL_STEPS, _ALWAYS_ALLOWED_US = 10, 50_000
_COUNTING_STEP_US = 1_000_000


@dataclass(frozen=True)
class Window:
    """A stretch of time, µs, whose end is excluded, and the instant of its reference view.

    `left_out` are, per camera, events before or after that no pose covers.
    """

    t0_us: int
    t1_us: int
    t_ref_us: int
    left_out: tuple[int, ...]


def choose_window(recording: Recording, config: MapperConfig) -> Window:
    """Finds the window that the configuration asks for.

    Without `start_s` and `duration_s`, which count from the first event, the window is everything
    that the poses cover; events before the first or after the last pose are left out and counted.
    With sliding windows this is the stretch that they slide over, and `plan_windows` cuts it.

    Raises:
        InputError: a window or reference time that events or poses do not cover, or poses
            missing in it; says by how much.
    """
    events, poses = _Span(*events_span_us(recording)), _Span(*recording.trajectory.span_us)
    t0_us = max(events.first_us, poses.first_us)
    t1_us = min(events.last_us, poses.last_us) + 1
    if t0_us >= t1_us:
        raise InputError(
            f"poses ({poses.first_us}..{poses.last_us} µs) and events "
            f"({events.first_us}..{events.last_us} µs) do not overlap: put them on one clock"
        )
    if config.start_s is not None:
        t0_us, t1_us = events.first_us + _to_us(config.start_s), events.last_us + 1
    if config.duration_s is not None:
        t1_us = t0_us + _to_us(config.duration_s)
    _check_inside("events", events, t0_us, t1_us)
    _check_inside("poses", poses, t0_us, t1_us)
    if not config.slides:
        check_poses(recording.trajectory, t0_us, t1_us, config)
    whole = config.start_s is None and config.duration_s is None
    outside = ((events.first_us, t0_us), (t1_us, events.last_us + 1)) if whole else ()
    passed = [step for part in outside for step in time_steps(recording, *part)]
    left_out = tuple(
        sum(len(recording.events(camera, *step)) for step in passed)
        for camera in range(len(recording.rig))
    )
    return Window(t0_us, t1_us, _reference_us(config, events, poses, t0_us, t1_us), left_out)


class _Span(NamedTuple):
    first_us: int
    last_us: int


def _check_inside(what: str, span: _Span, t0_us: int, t1_us: int) -> None:
    early_us, late_us = span.first_us - t0_us, t1_us - 1 - span.last_us
    if t0_us > span.last_us:
        raise InputError(
            f"window begins {(t0_us - span.last_us) / 1e6:.6f} s after the last of the {what}: "
            "choose an earlier start_s"
        )
    if early_us > 0:
        raise InputError(
            f"window begins {early_us / 1e6:.6f} s before the first of the {what}: choose a "
            "later start_s, or leave it out to use all that the poses cover"
        )
    if late_us > 0:
        raise InputError(
            f"window ends {late_us / 1e6:.6f} s after the last of the {what}: "
            f"choose duration_s of at most {(span.last_us + 1 - t0_us) / 1e6:.6f}"
        )


def _reference_us(config: MapperConfig, events: _Span, poses: _Span, t0_us: int, t1_us: int) -> int:
    if config.reference_s is None:
        end_us = min(t1_us, poses.last_us)
        return end_us if config.reference == "end" else (t0_us + t1_us) // 2
    t_ref_us = events.first_us + _to_us(config.reference_s)
    outside_us = max(poses.first_us - t_ref_us, t_ref_us - poses.last_us)
    if outside_us > 0:
        raise InputError(
            f"reference_s {config.reference_s:g} lies {outside_us / 1e6:.6f} s outside the poses: "
            "choose a time that they cover, or leave it out for the window's middle"
        )
    return t_ref_us


def _to_us(seconds: float) -> int:
    return round(seconds * 1e6)


def time_steps(recording: Recording, t0_us: int, t1_us: int) -> Iterator[Span]:
    """Cuts a stretch into seconds, for passes over what may be longer than memory.

    Long silences are stepped over.
    """
    return steps(occupied_spans(recording, t0_us, t1_us), _COUNTING_STEP_US)


def check_poses(trajectory: Trajectory, t0_us: int, t1_us: int, config: MapperConfig) -> None:
    """Refuses a window, `t0_us <= t < t1_us`, in which neighbouring poses lie too far apart."""
    first = max(int(np.searchsorted(trajectory.t_us, t0_us, side="right")) - 1, 0)
    last = int(np.searchsorted(trajectory.t_us, t1_us - 1, side="left")) + 1
    times = trajectory.t_us[first:last]
    if len(times) < 2:
        return
    steps = np.diff(times)
    k, limit_us = int(steps.argmax()), longest_gap_us(trajectory, config)
    if steps[k] > limit_us:
        raise InputError(
            f"no pose for {steps[k] / 1e6:.6g} s ({times[k]}..{times[k + 1]} µs) in the window: "
            f"at most {limit_us / 1e6:g} s are interpolated; choose another window, or set "
            "max_pose_gap_s"
        )


def longest_gap_us(trajectory: Trajectory, config: MapperConfig) -> int:
    """How long two poses may lie apart: as configured, else 10 median steps and at least 50 ms."""
    if config.max_pose_gap_s is not None:
        return _to_us(config.max_pose_gap_s)
    if len(trajectory) < 2:
        return _ALWAYS_ALLOWED_US
    return max(_ALWAYS_ALLOWED_US, round(_USUAL_STEPS * float(np.median(np.diff(trajectory.t_us)))))


@dataclass(frozen=True, eq=False)
class WindowPlan:
    """The windows of a run, in order.

    Attributes:
        begins_us: (K,) begin of each window, included.
        ends_us: (K,) end of each window, excluded.
        stretch: what they slide over, with the events that no pose covers.
        last_pose_us: time of the last pose.
        at_end: whether reference views lie at the windows' ends instead of their middles.
    """

    begins_us: Times
    ends_us: Times
    stretch: Window
    last_pose_us: int
    at_end: bool

    def __len__(self) -> int:
        return len(self.begins_us)

    def window(self, k: int) -> Window:
        """The k-th window, with a reference time of its own."""
        t0_us, t1_us = int(self.begins_us[k]), int(self.ends_us[k])
        t_ref_us = min(t1_us, self.last_pose_us) if self.at_end else (t0_us + t1_us) // 2
        return Window(t0_us, t1_us, t_ref_us, (0,) * len(self.stretch.left_out))

    def name(self, k: int) -> str:
        """The name of the k-th window's folder; names sort like the windows."""
        return f"w{k:0{max(3, len(str(len(self) - 1)))}d}"


def plan_windows(
    recording: Recording, config: MapperConfig, progress: Progress = silent
) -> WindowPlan:
    """Cuts what events and poses cover, or `start_s` and `duration_s` of it, into sliding windows.

    Windows by time follow each other every `stride_s`; windows by count hold `window_events` events
    of camera 0, and those of the same microsecond, every `stride_events` events. Only whole windows
    are taken. Where events are counted `progress` is called with `count`, seconds read and all.

    Raises:
        InputError: no window asked for, no room for one, or more than `MOST_WINDOWS` of them.
    """
    if not config.slides:
        raise InputError("no sliding windows: set window_s or window_events")
    stretch = choose_window(recording, config)
    if config.window_s is not None:
        begins_us, ends_us = _by_time(recording, config, stretch)
    else:
        begins_us, ends_us = _by_count(recording, config, stretch, progress)
    if len(begins_us) > MOST_WINDOWS:
        raise InputError(
            f"{len(begins_us)} windows, at most {MOST_WINDOWS}: raise the stride or the window"
        )
    last_pose_us = recording.trajectory.span_us[1]
    return WindowPlan(begins_us, ends_us, stretch, last_pose_us, config.reference == "end")


def _by_time(recording: Recording, config: MapperConfig, stretch: Window) -> tuple[Times, Times]:
    length_us = _at_least_1_us("window_s", config.window_s)
    stride_us = _at_least_1_us("stride_s", config.stride_s or config.window_s)
    room_us = stretch.t1_us - stretch.t0_us - length_us
    if room_us < 0:
        raise InputError(
            f"window_s is {length_us / 1e6:g}: events and poses cover "
            f"{(stretch.t1_us - stretch.t0_us) / 1e6:.6f} s; choose a shorter one"
        )
    numbers = [
        range(  # of windows that reach into the span
            max(0, -((length_us - 1 - (first_us - stretch.t0_us)) // stride_us)),
            min(end_us - 1 - stretch.t0_us, room_us) // stride_us + 1,
        )
        for first_us, end_us in occupied_spans(recording, stretch.t0_us, stretch.t1_us)
    ]
    if not any(numbers):
        raise InputError(
            f"no event from {stretch.t0_us} to {stretch.t1_us} µs: choose another start_s"
        )
    if (count := sum(map(len, numbers))) > MOST_WINDOWS:
        raise InputError(f"{count} windows, at most {MOST_WINDOWS}: raise stride_s or window_s")
    which = np.array([k for part in numbers for k in part], np.int64)
    begins_us = stretch.t0_us + stride_us * np.unique(which)
    return begins_us, begins_us + length_us


def _at_least_1_us(name: str, seconds: float | None) -> int:
    micros = _to_us(seconds or 0)
    if micros < 1:
        raise InputError(f"{name} is {seconds}: must be at least 1 µs")
    return micros


def _by_count(
    recording: Recording, config: MapperConfig, stretch: Window, progress: Progress
) -> tuple[Times, Times]:
    length = config.window_events or 0
    stride = config.stride_events or length
    begins: list[Times] = [np.empty(0, np.int64)]
    lasts: list[Times] = [np.empty(0, np.int64)]
    seen, parts = 0, list(time_steps(recording, stretch.t0_us, stretch.t1_us))
    for k, (t0_us, t1_us) in enumerate(parts):
        progress("count", k, len(parts))
        t_us = recording.events(0, t0_us, t1_us).t_us
        begins.append(_every(t_us, seen, 0, stride))
        lasts.append(_every(t_us, seen, length - 1, stride))
        seen += len(t_us)
    ends_us = np.concatenate(lasts) + 1
    if not len(ends_us):
        raise InputError(
            f"window_events is {length}: camera 0 has {seen} events that the poses cover; choose "
            "a smaller one"
        )
    return np.concatenate(begins)[: len(ends_us)], ends_us


def _every(t_us: Times, seen: int, first: int, stride: int) -> Times:
    """Times of a stream's events first, first + stride, ... in a piece behind `seen` others."""
    start = first - seen if seen <= first else (first - seen) % stride
    return np.array(t_us[start::stride], np.int64)
