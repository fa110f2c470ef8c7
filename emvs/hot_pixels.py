"""Pixels that fire far more often than what surrounds them: found, counted and left out.

Edges sweep over neighbouring pixels alike, so a pixel of a working sensor is about as active as the
most active of its neighbours; a defective one stands out alone. The reference of a pixel is the
fourth highest count among the 24 others of its 5 x 5 window (up to three of them may be defective
too), and at least the median of all pixels that fired. A pixel is hot where its count n exceeds
`ratio` times that reference by more than five standard deviations of a Poisson count:

    n > r + 5 sqrt(r),    r = ratio * max(fourth highest neighbour, median)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import Span, camera_spans
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.emvs.windows import time_steps

Mask = NDArray[np.bool_]
Counts = NDArray[np.int64]
_WINDOW_PX, _RANK, _SIGMAS = 5, 4, 5.0


@dataclass(frozen=True, eq=False)
class HotPixels:
    """The hot pixels of one camera.

    Attributes:
        mask: (H, W) bool, set where hot.
        events: events that those pixels sent in the stretch looked at.
    """

    mask: Mask
    events: int

    @property
    def pixels(self) -> int:
        """How many are hot."""
        return int(self.mask.sum())


def find_hot_pixels(
    recording: Recording, t0_us: int, t1_us: int, ratio: float, progress: Progress = silent
) -> tuple[HotPixels, ...]:
    """Looks for each camera's hot pixels in `t0_us <= t < t1_us`, a second of events at a time.

    A pixel is hot from `ratio` times its surroundings' activity on. `progress` is called with the
    stage `hot pixels`, how many cameras are done and how many there are.
    """
    hot = []
    for camera in range(len(recording.rig)):
        progress("hot pixels", camera, len(recording.rig))
        counts = _counts(recording, camera, t0_us, t1_us)
        mask = hot_mask(counts, ratio)
        hot.append(HotPixels(mask, int(counts[mask].sum())))
    return tuple(hot)


def hot_mask(counts: Counts, ratio: float) -> Mask:
    """Where (H, W) int64 events per pixel exceed their surroundings by more than `ratio`."""
    from scipy.ndimage import rank_filter  # needed by those who ask for it only

    fired = counts[counts > 0]
    if not fired.size:
        return np.zeros(counts.shape, bool)
    others = np.ones((_WINDOW_PX, _WINDOW_PX), bool)
    others[_WINDOW_PX // 2, _WINDOW_PX // 2] = False
    around = rank_filter(counts, -_RANK, footprint=others, mode="mirror")
    usual = ratio * np.maximum(around, np.median(fired))
    hot: Mask = counts > usual + _SIGMAS * np.sqrt(usual)
    return hot


class WithoutPixels(DerivedRecording):
    """A recording without the events of the pixels that `masks` sets, (H, W) bool per camera."""

    def __init__(self, recording: Recording, masks: Sequence[Mask]) -> None:
        super().__init__(recording)
        self.masks = tuple(masks)

    def occupied_us(self, camera: int) -> list[Span]:
        """First and last event of a camera's stretches without a long silence, µs."""
        return list(camera_spans(self.recording, camera))

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us` from the pixels that remain."""
        events = self.recording.events(camera, t0_us, t1_us)
        return events.take(~self.masks[camera][events.y, events.x])


def _counts(recording: Recording, camera: int, t0_us: int, t1_us: int) -> Counts:
    sensor = recording.rig.cameras[camera]
    counts = np.zeros(sensor.width_px * sensor.height_px, np.int64)
    for begin_us, end_us in time_steps(recording, t0_us, t1_us):
        events = recording.events(camera, begin_us, end_us)
        cell = events.y.astype(np.int64) * sensor.width_px + events.x
        counts += np.bincount(cell, minlength=counts.size)
    return counts.reshape(sensor.height_px, sensor.width_px)
