"""Pictures of a frame camera that looks through the event camera's lens, as linear light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.occupied import Span, closed_up

# Grey levels that are neither noise nor saturated, and how many pixels are looked at.
_LEVELS = 8, 247
_MOST_PIXELS = 60_000_000
_FEWEST = 3
# The time over which change of light is taken.
_SLOPE_US, _SMOOTH_PX = 50_000, 3


@dataclass(frozen=True)
class FrameStack:
    """Frames in order of time.

    Attributes:
        t_us: (T,) middles of the exposures, µs.
        light: (T, H, W) float32, 1 is full scale.
        usable: (T, H, W) neither dark nor saturated.
        timed: whether the times are known to be the exposures' middles.
    """

    t_us: NDArray[np.int64]
    light: NDArray[np.float32]
    usable: NDArray[np.bool_]
    timed: bool

    def closed_up(self, spans: Sequence[Span]) -> FrameStack | None:
        """The frames within half-open spans, on the clock that stands still between them, µs.

        None where there are not three; itself where there is one span.
        """
        if len(spans) < 2:
            return self
        kept = np.array([any(a <= t < b for a, b in spans) for t in self.t_us.tolist()])
        if kept.sum() < _FEWEST:
            return None
        t_us = closed_up(self.t_us[kept], spans)
        return replace(self, t_us=t_us, light=self.light[kept], usable=self.usable[kept])


def frames_of(
    recording: Any, camera: int, span_us: tuple[int, int] | None = None
) -> FrameStack | None:
    """A recording's frames within a span; None where there are not three, or of another size."""
    photos = hasattr(recording, "photo_times_us")
    times_us = (
        recording.photo_times_us(camera) if photos
        else recording.frame_times_us(camera) if hasattr(recording, "frame_times_us")
        else np.empty(0, np.int64)
    )  # fmt: skip
    if span_us is not None:
        times_us = times_us[(times_us >= span_us[0]) & (times_us <= span_us[1])]
    sensor = recording.rig.cameras[camera]
    shape = sensor.height_px, sensor.width_px
    times_us = times_us[: max(_FEWEST, _MOST_PIXELS // (shape[0] * shape[1]))]
    if len(times_us) < _FEWEST:
        return None
    light, usable = [], []
    for t_us in times_us.tolist():
        photo = recording.photo(camera, t_us) if photos else None
        image = photo.image if photo is not None else recording.frame(camera, t_us)
        if image.shape != shape:
            return None
        gain = photo.gain if photo is not None else 1.0
        light.append(image.astype(np.float32) / np.float32(255 * gain))
        usable.append((image >= _LEVELS[0]) & (image <= _LEVELS[1]))
    return FrameStack(np.asarray(times_us, np.int64), np.array(light), np.array(usable), photos)


class Expected:
    """How many events per second frames lead one to expect of each pixel, and its light."""

    def __init__(self, frames: FrameStack, threshold: float, log_eps: float) -> None:
        self._t_us, self._threshold, self._log_eps = frames.t_us, threshold, log_eps
        smooth = [cv2.blur(light, (_SMOOTH_PX, _SMOOTH_PX)) for light in frames.light]
        self._log = np.log(np.stack(smooth) + np.float32(log_eps)).reshape(len(smooth), -1)
        self._half = max(1, round(_SLOPE_US / 2 / float(np.median(np.diff(frames.t_us)))))

    def __call__(self, t_us: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(P,) both at a time, µs; the rate is infinite where there are no frames."""
        if not self._t_us[0] <= t_us <= self._t_us[-1]:
            return np.full(self._log.shape[1], np.inf), np.ones(self._log.shape[1])
        k = int(np.argmin(np.abs(self._t_us - t_us)))
        a, b = max(k - self._half, 0), min(k + self._half, len(self._t_us) - 1)
        seconds = (self._t_us[b] - self._t_us[a]) * 1e-6
        change = np.abs(self._log[b] - self._log[a]).astype(np.float64)
        light = np.exp(self._log[k].astype(np.float64)) - self._log_eps
        return change / (seconds * self._threshold), light
