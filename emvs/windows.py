"""Sliding windows over a whole recording: which stretch of time each of them is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.errors import InputError
from emvs.utils.runtime import Progress, silent
from emvs.window import Window, choose_window, time_steps

MOST_WINDOWS = 1_000_000

Times = NDArray[np.int64]


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
    are taken.

    Args:
        recording: events and poses.
        config: `window_s` and `stride_s`, or `window_events` and `stride_events`.
        progress: told the stage `count`, seconds read and all, where events are counted.

    Raises:
        InputError: no window asked for, no room for one, or more than `MOST_WINDOWS` of them.
    """
    if not config.slides:
        raise InputError("no sliding windows asked for: set window_s or window_events")
    stretch = choose_window(recording, config)
    cut = _by_time if config.window_s is not None else _by_count
    begins_us, ends_us = cut(recording, config, stretch, progress)
    if len(begins_us) > MOST_WINDOWS:
        raise InputError(f"{len(begins_us)} windows, at most {MOST_WINDOWS}: raise the stride")
    last_pose_us = recording.trajectory.span_us[1]
    return WindowPlan(begins_us, ends_us, stretch, last_pose_us, config.reference == "end")


def _by_time(
    recording: Recording, config: MapperConfig, stretch: Window, progress: Progress
) -> tuple[Times, Times]:
    del recording, progress
    length_us = _micros("window_s", config.window_s)
    stride_us = _micros("stride_s", config.stride_s or config.window_s)
    room_us = stretch.t1_us - stretch.t0_us - length_us
    if room_us < 0:
        raise InputError(
            f"window_s is {length_us / 1e6:g}: events and poses cover "
            f"{(stretch.t1_us - stretch.t0_us) / 1e6:.6f} s; choose a shorter one"
        )
    if room_us // stride_us >= MOST_WINDOWS:
        count = room_us // stride_us + 1
        raise InputError(f"{count} windows, at most {MOST_WINDOWS}: raise stride_s")
    begins_us = stretch.t0_us + stride_us * np.arange(room_us // stride_us + 1, dtype=np.int64)
    return begins_us, begins_us + length_us


def _micros(name: str, seconds: float | None) -> int:
    micros = round((seconds or 0) * 1e6)
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
    seen, steps = 0, list(time_steps(stretch.t0_us, stretch.t1_us))
    for k, (t0_us, t1_us) in enumerate(steps):
        progress("count", k, len(steps))
        t_us = recording.events(0, t0_us, t1_us).t_us
        begins.append(_every(t_us, seen, 0, stride))
        lasts.append(_every(t_us, seen, length - 1, stride))
        seen += len(t_us)
    ends_us = np.concatenate(lasts) + 1
    if not len(ends_us):
        raise InputError(
            f"window_events is {length}: camera 0 has {seen} events that poses cover; choose fewer"
        )
    return np.concatenate(begins)[: len(ends_us)], ends_us


def _every(t_us: Times, seen: int, first: int, stride: int) -> Times:
    """Times of the events number first, first + stride, ... of a stream, within one piece of it.

    Args:
        t_us: times of the piece.
        seen: events of the stream before it.
        first: number of the first event wanted.
        stride: from one to the next.
    """
    start = first - seen if seen <= first else (first - seen) % stride
    return np.array(t_us[start::stride], np.int64)
