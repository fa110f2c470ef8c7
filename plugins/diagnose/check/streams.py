"""Statistics of events for checks: counts, rates and times of each camera, in bounded memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording, events_span_us
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.emvs.windows import time_steps

BIN_US = 1000
"""Width of a bin of rates."""
_QUICK_PIECES, _QUICK_US = 10, 100_000
_MOST_TIMED = 200_000  # events of a piece whose intervals are measured
Piece = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Stream:
    """Statistics of one camera's events in the stretches that were read.

    Attributes:
        events: how many.
        brighter: how many of polarity 1.
        pixels: (H, W) int64 events per pixel.
        rates: per stretch, (N,) int64 events in each millisecond.
        begins_us: when each stretch begins.
        step_us: the greatest step that all time stamps are multiples of, µs.
        backwards: events with an earlier time than the one before.
        intervals_us: a sample of times between two events of one pixel and polarity, µs.
        largest_px: largest column and row of any event.
    """

    events: int
    brighter: int
    pixels: NDArray[np.int64]
    rates: tuple[NDArray[np.int64], ...]
    begins_us: tuple[int, ...]
    step_us: int
    backwards: int
    intervals_us: NDArray[np.int64]
    largest_px: tuple[int, int]

    @property
    def is_off_sensor(self) -> bool:
        """Whether there are events off the sensor."""
        height, width = self.pixels.shape
        x_px, y_px = self.largest_px
        return bool(x_px >= width or y_px >= height)

    @property
    def seconds(self) -> float:
        """How much time was read."""
        return sum(map(len, self.rates)) * BIN_US / 1e6

    @property
    def rate_hz(self) -> float:
        """Mean events per second."""
        return self.events / self.seconds if self.seconds else 0.0


def pieces(recording: Recording, *, thorough: bool) -> list[Piece]:
    """The stretches to read: everything a second at a time, or ten of 0.1 s spread over it.

    Args:
        recording: any.
        thorough: whether to read everything.
    """
    first_us, last_us = events_span_us(recording)
    last_us += 1
    if thorough or last_us - first_us <= _QUICK_PIECES * _QUICK_US:
        return list(time_steps(first_us, last_us))
    begins = np.linspace(first_us, last_us - _QUICK_US, _QUICK_PIECES).astype(np.int64)
    return [(int(t_us), int(t_us) + _QUICK_US) for t_us in begins]


def read_streams(
    recording: Recording, stretches: Sequence[Piece], progress: Progress = silent
) -> tuple[Stream, ...]:
    """Reads the stretches of every camera once.

    Args:
        recording: any.
        stretches: half-open, µs.
        progress: called with the stage `events`, the stretches done, and their number.

    Raises:
        InputError: what the recording refuses to read: damaged or unsorted events, events off the
            sensor.
    """
    cameras = range(len(recording.rig))
    total = len(stretches) * len(cameras)
    streams = []
    for camera in cameras:
        reader = _Reader(recording, camera)
        for k, (t0_us, t1_us) in enumerate(stretches):
            progress("events", camera * len(stretches) + k, total)
            reader.add(recording.events(camera, t0_us, t1_us), t0_us, t1_us)
        streams.append(reader.stream())
    return tuple(streams)


class _Reader:
    """Adds up the stretches of one camera."""

    def __init__(self, recording: Recording, camera: int) -> None:
        sensor = recording.rig.cameras[camera]
        self._size = sensor.width_px, sensor.height_px
        self._pixels = np.zeros(sensor.width_px * sensor.height_px, np.int64)
        self._events = self._brighter = self._backwards = self._step_us = 0
        self._largest_px = -1, -1
        self._rates: list[NDArray[np.int64]] = []
        self._begins_us: list[int] = []
        self._intervals: list[NDArray[np.int64]] = []

    def add(self, events: Events, t0_us: int, t1_us: int) -> None:
        """Takes in the events of one stretch."""
        bins = -(-(t1_us - t0_us) // BIN_US)
        place = np.clip((events.t_us - t0_us) // BIN_US, 0, bins - 1)
        self._rates.append(np.bincount(place, minlength=bins))
        self._begins_us.append(t0_us)
        self._events += len(events)
        if not len(events):
            return
        self._brighter += int(np.count_nonzero(events.p))
        x_px, y_px = self._largest_px
        self._largest_px = max(x_px, int(events.x.max())), max(y_px, int(events.y.max()))
        if self._largest_px[0] >= self._size[0] or self._largest_px[1] >= self._size[1]:
            return  # off the sensor: nothing else is counted
        cell = events.y.astype(np.int64) * self._size[0] + events.x
        self._pixels += np.bincount(cell, minlength=len(self._pixels))
        steps = np.diff(events.t_us)
        self._backwards += int(np.count_nonzero(steps < 0))
        self._step_us = int(np.gcd.reduce(np.append(steps, self._step_us)))
        self._time(cell[:_MOST_TIMED] * 2 + (events.p[:_MOST_TIMED] > 0), events.t_us[:_MOST_TIMED])

    def _time(self, which: NDArray[np.int64], t_us: NDArray[np.int64]) -> None:
        order = np.lexsort((t_us, which))
        same = np.diff(which[order]) == 0
        self._intervals.append(np.diff(t_us[order])[same])

    def stream(self) -> Stream:
        """The statistics of all stretches."""
        width, height = self._size
        intervals = np.concatenate(self._intervals) if self._intervals else np.empty(0, np.int64)
        return Stream(
            self._events, self._brighter, self._pixels.reshape(height, width), tuple(self._rates),
            tuple(self._begins_us), self._step_us, self._backwards, intervals, self._largest_px,
        )  # fmt: skip
