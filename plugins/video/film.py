"""A video in front of a sensor: its frames as light, the events between them, what was seen."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.plugins.video.frames import Frame, Frames, checked
from eventsweep.plugins.video.light import Light
from eventsweep.plugins.video.upsampling import find_upsampler, upsampled
from eventsweep.sim.config import PixelConfig, VideoConfig
from eventsweep.sim.sensor.labels import LabelledEvents
from eventsweep.sim.sensor.sensor import Sensor

Item = TypeVar("Item")
TOO_FAST = 0.2
"""Frames are too far apart where half their rate would lose a larger share of events, see `Pace`.
"""
_SAMPLED_PIXELS = 1 << 14


class Film:
    """Frames that a sensor watches: iterating gives the events between each two of them.

    The first frame is read at once: it says how large the sensor is.

    Attributes:
        frames: where they come from.
        pixels: how light becomes events.
        video: what light the frames stand for, and what puts more of them in between.
        seed: of all that the sensor draws.
        light: what turns frames into light.
        width_px, height_px: of the frames.
        count: frames so far, those in between included.
        events: events so far.
        span_us: times of the first frame and of the latest.
        pace: whether frames are close enough together.

    Raises:
        InputError: no frame that can be read, or no function of the name to put frames in between.
    """

    def __init__(self, frames: Frames, pixels: PixelConfig, video: VideoConfig, seed: int) -> None:
        self.frames, self.pixels, self.video, self.seed = frames, pixels, video, seed
        sources: Iterable[Frame] = checked(frames, frames.path)
        if video.upsample is not None:
            sources = upsampled(sources, find_upsampler(video.upsample), video.upsample)
        self._rest = iter(sources)
        first = next(self._rest)
        self.height_px, self.width_px = first.image.shape[:2]
        self.light = Light(first.image.dtype, video)
        self._first = first
        self.sensor = Sensor(0, self.width_px, self.height_px, pixels, seed)
        self.pace = Pace(pixels)
        self.count = self.events = 0
        self.span_us = first.t_us, first.t_us

    def __iter__(self) -> Generator[LabelledEvents]:
        """Packets in order of time, one from each frame to the next.

        Raises:
            InputError: a frame that cannot be read, does not fit the others, or is no light.
        """
        for frame, light in ahead(self._lit()):
            self.pace.take(light)
            if not self.count:
                self.sensor.start(light, frame.t_us)
            else:
                labelled = self.sensor.step(light, frame.t_us)
                self.events += len(labelled)
                self.span_us = self.span_us[0], frame.t_us
                yield labelled
            self.count += 1
        self.sensor.finish()

    def _lit(self) -> Iterator[tuple[Frame, NDArray[np.float32]]]:
        """Frames and their light."""
        for frame in chain([self._first], self._rest):
            light = self.light(frame.image)
            low, high = float(light.min()), float(light.max())
            if not (low >= 0 and np.isfinite(high)):
                raise InputError(
                    f"{self.frames.path}: {frame.name} decodes to light from {low:g} to {high:g} "
                    f"({self.light.said}); needs finite values of at least 0"
                )
            yield frame, light


def ahead(items: Iterator[Item]) -> Iterator[Item]:
    """The items, each made in a thread while the one before is at work."""
    nothing = object()
    with ThreadPoolExecutor(1) as thread:
        coming = thread.submit(next, items, nothing)
        while (item := coming.result()) is not nothing:
            coming = thread.submit(next, items, nothing)
            yield item  # type: ignore[misc]


class Pace:
    """Whether frames are close enough together for straight lines between them.

    Of every three frames in a row: how much less a pixel's logarithm would have moved, in all, had
    the middle one been missing. Summed over all pixels that moved by at least a contrast threshold,
    this is the share of the events that half the frame rate would have lost. It is 0 where every
    pixel only rises or only falls within three frames, and 1/2 where frames have nothing to do with
    one another; what the full rate itself loses is less, and of the same order. About 2^14 pixels,
    evenly spread, are looked at.
    """

    def __init__(self, pixels: PixelConfig) -> None:
        self._threshold = min(pixels.contrast_threshold_pos, pixels.contrast_threshold_neg)
        self._log_eps = np.float32(pixels.log_eps)
        self._latest: list[NDArray[np.float32]] = []
        self._moved = self._lost = 0.0

    @property
    def lost_at_half_rate(self) -> float:
        """Share of the events that would be missing without every second frame, 0 to 1."""
        return max(0.0, self._lost / self._moved) if self._moved else 0.0

    @property
    def too_fast(self) -> bool:
        """Whether a camera would have seen something else."""
        return self.lost_at_half_rate > TOO_FAST

    def take(self, light: NDArray[np.float32]) -> None:
        """Looks at the next frame (H, W)."""
        stride = max(1, int((light.size / _SAMPLED_PIXELS) ** 0.5))
        log = np.log(light[::stride, ::stride] + self._log_eps)
        if len(self._latest) == 2:
            first, middle = self._latest
            moved = np.abs(middle - first) + np.abs(log - middle)
            events = moved >= self._threshold
            self._moved += float(moved[events].sum())
            self._lost += float((moved - np.abs(log - first))[events].sum())
        self._latest = [*self._latest[-1:], log]
