"""A video in front of a sensor: its frames as light, the events between them, what was seen."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from sim.config import PixelConfig, VideoConfig
from sim.sensor.labels import LabelledEvents
from sim.sensor.sensor import Sensor
from sim.video.frames import Frame, Frames, checked
from sim.video.light import Light
from sim.video.upsampling import find_upsampler, upsampled

Item = TypeVar("Item")
TOO_FAST = 3.0
"""Beyond this many thresholds per change frames are too far apart, see `Pace`."""
_SAMPLED_PIXELS = 1 << 14


class Film:
    """Frames that a sensor watches: iterating gives the events between each two of them.

    The first frame is read at once: it says how large the sensor is.

    Args:
        frames: where they come from.
        pixels: how light becomes events.
        video: what light the frames stand for, and what puts more of them in between.
        seed: of all that the sensor draws.

    Attributes:
        light: what turns frames into light.
        width_px: columns.
        height_px: rows.
        count: frames so far, those in between included.
        events: events so far.
        span_us: times of the first frame and of the latest.
        pace: how much pixels change from frame to frame.

    Raises:
        InputError: no frame that can be read, or no function of the name to put frames in between.
    """

    def __init__(self, frames: Frames, pixels: PixelConfig, video: VideoConfig, seed: int) -> None:
        self.frames = frames
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
            self.pace.take(light, frame.t_us)
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
                    f"{self.frames.path}: {frame.name} stands for light from {low:g} to {high:g} "
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


class Change(NamedTuple):
    """How much pixels changed between two frames.

    Attributes:
        t_us: when the later one was taken, µs.
        thresholds: mean number of thresholds that pixels passed which passed any.
    """

    t_us: int
    thresholds: float


class Pace:
    """How far apart frames are, in what pixels pass between two of them.

    The measure is the number of contrast thresholds that a pixel's logarithm passes from one frame
    to the next, averaged over the pixels that pass at least one. Where an edge moves by less than
    its own width between frames, a pixel takes several frames over it, and passes one or two at a
    time; where it jumps, pixels pass the whole contrast at once, all over the stretch that it
    jumped, and the straight line between the frames is not what they would have seen. About 2^14
    pixels, evenly spread, are looked at.
    """

    def __init__(self, pixels: PixelConfig) -> None:
        self._thresholds = pixels.contrast_threshold_pos, pixels.contrast_threshold_neg
        self._log_eps = np.float32(pixels.log_eps)
        self._before: NDArray[np.float32] | None = None
        self._passed = self._changed = 0
        self.largest = Change(0, 0.0)

    @property
    def thresholds_per_change(self) -> float:
        """The measure over all frames; 0 where nothing changed."""
        return self._passed / self._changed if self._changed else 0.0

    @property
    def too_fast(self) -> bool:
        """Whether a camera would have seen something else."""
        return self.thresholds_per_change > TOO_FAST

    def take(self, light: NDArray[np.float32], t_us: int) -> None:
        """Looks at the next frame (H, W)."""
        stride = max(1, int((light.size / _SAMPLED_PIXELS) ** 0.5))
        log = np.log(light[::stride, ::stride] + self._log_eps)
        if self._before is not None:
            rise = log - self._before
            number = np.where(rise > 0, rise / self._thresholds[0], -rise / self._thresholds[1])
            passed = np.floor(number[number >= 1])
            self._add(int(passed.sum()), len(passed), t_us)
        self._before = log

    def _add(self, passed: int, changed: int, t_us: int) -> None:
        self._passed, self._changed = self._passed + passed, self._changed + changed
        if changed and passed / changed > self.largest.thresholds:
            self.largest = Change(t_us, passed / changed)
