"""Time surfaces: per pixel, how recently it last fired, as an exponential decay.

`exp(-(t - t_last) / decay)` after Lagorce et al., *HOTS*, TPAMI 2017, with the 30 ms and the 3x3
median that the published ESVO (Zhou, Gallego, Shen, TRO 2021) uses, polarity ignored.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.baselines.pixels_kernels import NEVER_US, decay, stamp
from eventsweep.emvs.baselines.rectification import Rectified
from eventsweep.emvs.config import EsvoParameters, SgmParameters
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError

Image = NDArray[np.float32]


class TimeSurface:
    """The last event of every pixel of one camera, kept up to date event by event.

    Args:
        width_px: columns.
        height_px: rows.
        decay_s: time constant, s.
        median_px: window of the median over the surface: 1 (none), 3 or 5 px.
        blur_sigma_px: standard deviation of a Gaussian after it, px; 0 for none.

    Attributes:
        last_us: (H, W) int64 time of each pixel's last event, µs; `NEVER_US` where there was none.
        newest_us: time of the last event that was taken, µs, `NEVER_US` before any.
    """

    def __init__(
        self, width_px: int, height_px: int, decay_s: float = 0.03, *, median_px: int = 3,
        blur_sigma_px: float = 0.0,
    ) -> None:  # fmt: skip
        self.decay_s, self.median_px, self.blur_sigma_px = decay_s, median_px, blur_sigma_px
        self.last_us = np.full((height_px, width_px), NEVER_US, np.int64)
        self.newest_us = int(NEVER_US)

    def update(self, events: Events) -> None:
        """Takes the next events, in sensor pixels; they must not be older than those before.

        Raises:
            InputError: events that go back in time, or that lie outside the surface.
        """
        if not len(events):
            return
        first_us = int(events.t_us[0])
        if first_us < self.newest_us:
            raise InputError(
                f"time surface: event at {first_us} µs after one at {self.newest_us} µs: feed "
                "events in time order"
            )
        height_px, width_px = self.last_us.shape
        events.checked(width_px, height_px)
        stamp(events.x, events.y, events.t_us, self.last_us)
        self.newest_us = int(events.t_us[-1])

    def at(self, t_us: int, *, smooth: bool = True) -> Image:
        """The surface, float32 in 0..1, at a time, µs, that is not before the newest event.

        1 stands for an event right now, 0 for none yet; `smooth` applies the median and the
        Gaussian.

        Raises:
            InputError: a time before the newest event, whose pixel no longer knows its past.
        """
        if t_us < self.newest_us:
            raise InputError(
                f"time surface requested at {t_us} µs, but it holds events up to "
                f"{self.newest_us} µs: request it before feeding later events"
            )
        surface = np.empty(self.last_us.shape, np.float32)
        decay(self.last_us, t_us, self.decay_s * 1e6, surface)
        if smooth and self.median_px > 1:
            surface = np.asarray(cv2.medianBlur(surface, self.median_px), np.float32)
        if smooth and self.blur_sigma_px > 0:
            blurred = cv2.GaussianBlur(surface, (0, 0), self.blur_sigma_px)
            surface = np.asarray(blurred, np.float32)
        return surface

    def active(self, t_us: int, within_s: float) -> NDArray[np.bool_]:
        """(H, W) bool, which pixels fired in the last `within_s` before `t_us`."""
        recent: NDArray[np.bool_] = self.last_us >= t_us - round(within_s * 1e6)
        fired: NDArray[np.bool_] = self.last_us != NEVER_US
        return recent & fired


class SurfacePair:
    """The time surfaces of `both` cameras of a stereo pair, fed up to growing times `fed_us`."""

    def __init__(
        self, recording: Recording, stereo: Rectified, start_us: int,
        parameters: EsvoParameters | SgmParameters, blur_sigma_px: float = 0.0,
    ) -> None:  # fmt: skip
        self._recording, self._stereo, self.fed_us = recording, stereo, start_us
        sensors = (recording.rig.cameras[k] for k in stereo.cameras)
        self.both = tuple(
            TimeSurface(
                sensor.width_px, sensor.height_px, parameters.decay_s,
                median_px=parameters.median_px, blur_sigma_px=blur_sigma_px,
            )
            for sensor in sensors
        )  # fmt: skip

    def feed(self, t_us: int) -> None:
        """Takes the events of both cameras before `t_us`, µs."""
        for camera, surface in zip(self._stereo.cameras, self.both, strict=True):
            surface.update(self._recording.events(camera, self.fed_us, t_us))
        self.fed_us = t_us

    def images(self, t_us: int) -> list[Image]:
        """Both surfaces at `t_us`, rectified."""
        return [self._stereo.image(k, surface.at(t_us)) for k, surface in enumerate(self.both)]
