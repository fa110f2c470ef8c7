"""What seems wrong with the frames of a video that can be read: brightness, times, repetitions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from eventsweep.emvs.errors import significant
from eventsweep.plugins.video.frames import Frame
from eventsweep.sim.config import PixelConfig, VideoConfig

_BITS = (8, 10, 12, 14)
"""Sensors' bits that are stored in 16: the brightest value of such frames fits into them."""
_HOLE_STEPS, _DROPPED_STEPS = 2.5, 1.8
_UNEVEN_STEPS, _DROPPED_SHARE = 1.5, 0.05
_REPEATED_SHARE = 0.05
_UNUSUAL_S = (2e-5, 5.0)
_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class Doubts:
    """Looks at frames as they pass, and says what a user should know."""

    def __init__(self, path: Path, video: VideoConfig, pixels: PixelConfig) -> None:
        self._path, self._video, self._pixels = path, video, pixels
        self._t_us: list[int] = []
        self._brightest = 0.0
        self._full_scale: int | None = None
        self._dark_first = self._repeated = 0

    def watched(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """The frames as they are."""
        before: Frame | None = None
        for frame in frames:
            self._t_us.append(frame.t_us)
            brightest = float(frame.image.max())
            self._dark_first += not max(brightest, self._brightest) > 0
            self._brightest = max(brightest, self._brightest)
            if frame.image.dtype == np.uint16 and self._video.full_scale is None:
                self._full_scale = np.iinfo(np.uint16).max
            self._repeated += before is not None and np.array_equal(before.image, frame.image)
            before = frame
            yield frame

    def notes(self, events: int) -> list[str]:
        """A line for each doubt, when all frames have passed and made so many events."""
        lines = (*self._of_light(), *self._of_times(), *self._of_repetitions(), *self._of(events))
        return [f"{self._path}: {line}" for line in lines]

    def _of_light(self) -> Iterator[str]:
        if 0 < self._dark_first < len(self._t_us):
            frames = "frame is" if self._dark_first == 1 else f"{self._dark_first} frames are"
            yield (
                f"the first {frames} all black: what comes up then are events of no motion; "
                "leave black frames out"
            )
        bits = next((bits for bits in _BITS if self._brightest < 1 << bits), None)
        if self._full_scale is None or bits is None or not self._brightest:
            return
        share = significant(100 * self._brightest / self._full_scale, 2)
        yield (
            f"the brightest value, {self._brightest:g}, is {share} % of full scale, "
            f"{self._full_scale}: if the camera gives {bits} bits, set full_scale to "
            f"{(1 << bits) - 1}"
        )

    def _of_times(self) -> Iterator[str]:
        steps_s = np.diff(self._t_us) / 1e6
        usual_s, at = float(np.median(steps_s)), int(np.argmax(steps_s))
        longest_s, uneven = float(steps_s[at]), float(np.mean(steps_s > _UNEVEN_STEPS * usual_s))
        # Frames that were rendered as the scene moves have many steps of other lengths.
        least = _DROPPED_STEPS if uneven < _DROPPED_SHARE else _HOLE_STEPS
        if longest_s > least * usual_s and len(steps_s) > 2:
            yield (
                f"the longest step between frames, after {self._t_us[at] / 1e6:g} s, is "
                f"{longest_s:.3g} s, {longest_s / usual_s:.2g} times the median: frames may be "
                "missing, and light is taken to change evenly meanwhile"
            )
        if not _UNUSUAL_S[0] <= usual_s <= _UNUSUAL_S[1] and self._video.rate_hz is None:
            units = (u for u, s in _UNITS.items() if 1e-3 <= usual_s * s <= 1)
            unit = next(units, None) if self._video.unit is None else None
            cure = f"if times are in {unit}, set unit to {unit}" if unit else "check their unit"
            yield f"frames are {usual_s:.3g} s apart in the median: {cure}"

    def _of_repetitions(self) -> Iterator[str]:
        steps = len(self._t_us) - 1
        if _REPEATED_SHARE * steps < self._repeated < steps:
            yield (
                f"{self._repeated} of {steps} frames repeat the one before: light stands still "
                "there, and jumps after; leave repeated frames out, with their times"
            )

    def _of(self, events: int) -> Iterator[str]:
        if events:
            return
        threshold = min(self._pixels.contrast_threshold_pos, self._pixels.contrast_threshold_neg)
        why = (
            "all frames are the same" if self._repeated == len(self._t_us) - 1
            else f"ln of no pixel's light changes by the contrast threshold, {threshold:g}"
        )  # fmt: skip
        yield f"no events: {why}"
