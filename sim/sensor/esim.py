"""The event model of ESIM: contrast thresholds on linearly interpolated log intensity.

Rebecq, Gehrig, Scaramuzza, "ESIM: an Open Event Camera Simulator", CoRL 2018, section 3.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError, check_array, check_whole
from eventsweep.sim.compensation.interval import Passage
from eventsweep.sim.config import PixelConfig
from eventsweep.sim.sensor import compensated_kernels
from eventsweep.sim.sensor import esim_kernels as kernels

# Long before any time stamp, so that a pixel's first event is never held back.
NEVER_US = -(2**62)
# Up to here one bucket per microsecond sorts faster than comparing does.
_MAX_BUCKETS = 2**16


class EventSimulator:
    """One camera's pixels: feed it frames, it returns events.

    Every pixel remembers a reference log intensity. When the log intensity, interpolated linearly
    between two frames, passes the reference by C+ upwards or C- downwards, the pixel emits an event
    at the moment of crossing and the reference moves by that threshold. A crossing during the
    refractory period after the last *emitted* event moves the reference in silence.

    References are kept as counts of crossings from the first frame, so they carry no drift.
    """

    def __init__(self, width_px: int, height_px: int, config: PixelConfig | None = None) -> None:
        check_whole("width_px", width_px)
        check_whole("height_px", height_px)
        if width_px < 1 or height_px < 1:
            raise InputError(f"a sensor of {width_px} x {height_px} px: both must be at least 1")
        self._shape = (height_px, width_px)
        self._config = PixelConfig.or_default(config)
        self._t_us: int | None = None
        self.suppressed = 0
        """Crossings so far that fell into a refractory period."""

    def __repr__(self) -> str:
        rows, columns = self._shape
        last = "no frame yet" if self._t_us is None else f"last frame at {self._t_us} µs"
        return f"EventSimulator({columns} x {rows} px, {last})"

    def start(self, intensity: NDArray[np.float32], t_us: int) -> None:
        """Takes the first frame (H, W), linear, full scale 1: it sets every pixel's reference.

        Raises:
            InputError: a time that is not whole, or what `step` refuses of an intensity.
        """
        check_whole("t_us", t_us)
        self._log = self._log_of(intensity)
        self._reference = self._log.astype(np.float64)
        self._memory = np.zeros(self._log.size, kernels.PIXEL)
        self._memory["first_log"] = self._log
        self._memory["last_emitted_us"] = NEVER_US
        self._fired, self._crossings = np.empty((2, self._log.size), np.int32)
        self._t_us = t_us

    def step(self, intensity: NDArray[np.float32], t_us: int) -> Events:
        """The events between the frame before and this one (H, W), linear, full scale 1, at `t_us`.

        Their times lie in (previous, `t_us`]; they are sorted by time, then row, then column.

        Raises:
            InputError: no first frame, time not after the frame before, or an intensity that is
                negative, not finite or of another size.
        """
        before_us = time_before(self._t_us, t_us)
        log_now = self._log_of(intensity)
        number = kernels.find(
            log_now, *self._thresholds, None, self._reference, self._memory,
            self._fired, self._crossings,
        )  # fmt: skip
        events = self._emit(log_now, before_us, t_us, number) if number else Events.empty()
        self._log, self._t_us = log_now, t_us
        return events

    def between(self, passage: Passage) -> Events:
        """The events between the frame taken last and the next fine one, light carried along.

        Raises:
            InputError: no first frame, or a passage that begins at another time.
        """
        interval, before, after = passage.interval, passage.before, passage.after
        before_us = time_before(self._t_us, interval.after_us)
        if before_us != interval.before_us or before.shape != self._shape:
            raise InputError(
                f"a passage from {interval.before_us} µs of {before.shape} pixels after a frame at "
                f"{before_us} µs of {self._shape}: give the one that begins there"
            )
        step_us = interval.after_us - before_us
        pixels = compensated_kernels.Pixels(
            self._reference, self._memory, *self._thresholds, self._config.log_eps
        )
        rise_light, fall_light = np.empty((2, self._reference.size))
        compensated_kernels.thresholds(pixels, rise_light, fall_light)
        a, b = before.reach, after.reach
        frames = compensated_kernels.Frames(
            before.light, after.light, a.slope, b.slope, before.grid, before.border_px,
            np.minimum(a.low, b.low), np.maximum(a.high, b.high),
        )  # fmt: skip
        events = compensated_kernels.events_between(
            frames, passage.layered, passage.geometry, pixels, rise_light, fall_light, step_us
        )
        self._log, self._t_us = self._log_of(after.pixels), interval.after_us
        return self._sent(*events, before_us, step_us)

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything that later events depend on; valid until the next `step`."""
        return {
            "log": self._log,
            "reference": self._reference,
            "memory": self._memory,
            "t_us": np.array(self._t_us),
            "suppressed": np.array(self.suppressed),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Goes on from `state`, exactly as the simulator that gave it."""
        self._log = state["log"].copy()
        self._reference, self._memory = state["reference"].copy(), state["memory"].copy()
        self._fired, self._crossings = np.empty((2, self._log.size), np.int32)
        self._t_us, self.suppressed = int(state["t_us"]), int(state["suppressed"])

    @property
    def _thresholds(self) -> tuple[float, float]:
        return self._config.contrast_threshold_pos, self._config.contrast_threshold_neg

    def _emit(self, log_now: NDArray[np.float32], before_us: int, t_us: int, number: int) -> Events:
        fired, crossings = self._fired[:number], self._crossings[:number]
        total, step_us = int(np.abs(crossings).sum()), t_us - before_us
        pixel, offset_us = np.empty(total, np.int32), np.empty(total, np.int64)
        p = np.empty(total, np.uint8)
        kernels.emit(
            self._log, log_now, *self._thresholds, None, self._reference, self._memory,
            fired, crossings, step_us, pixel, offset_us, p, p,
        )  # fmt: skip
        return self._sent(pixel, offset_us, p, before_us, step_us)

    def _sent(
        self, pixel: NDArray[np.integer], offset_us: NDArray[np.int64], p: NDArray[np.uint8],
        before_us: int, step_us: int,
    ) -> Events:  # fmt: skip
        """Crossings, each pixel's in order of time, without those in silence, sorted."""
        kept, last_us = np.empty(len(pixel), np.bool_), self._memory["last_emitted_us"]
        t_us = before_us + offset_us
        # Without a refractory period, too: what comes before the pixel's event before is left out.
        kernels.awake(pixel, t_us, self._config.refractory_period_us, last_us, kept)
        offset_us *= kept
        order = time_order(offset_us, step_us)
        self.suppressed += len(pixel) - len(order)
        pixel = pixel[order]
        y = pixel // self._shape[1]
        x = pixel - y * self._shape[1]
        return Events(x.astype(np.uint16), y.astype(np.uint16), t_us[order], p[order])

    def _log_of(self, intensity: NDArray[np.float32]) -> NDArray[np.float32]:
        return log_intensity(intensity, self._shape, self._config.log_eps)


def time_before(before_us: int | None, t_us: int) -> int:
    """The time of the frame before one at `t_us`, µs.

    Raises:
        InputError: there was none, or it was not earlier.
    """
    if before_us is None:
        raise InputError("step() before start(): give the first frame to start()")
    check_whole("t_us", t_us)
    if t_us <= before_us:
        raise InputError(
            f"frame at {t_us} µs after one at {before_us} µs: times must increase by at least 1 µs"
        )
    return before_us


def log_intensity(
    intensity: NDArray[np.float32], shape: tuple[int, int], log_eps: float
) -> NDArray[np.float32]:
    """(P,) logarithm of a frame (H, W) plus `log_eps`.

    Raises:
        InputError: what `check_intensity` refuses.
    """
    check_intensity(intensity, shape)
    # Rounded from doubles: of float32, processors have logarithms of their own.
    light = intensity.astype(np.float32, copy=False) + np.float32(log_eps)
    log: NDArray[np.float32] = np.log(light.ravel(), dtype=float).astype(np.float32)
    return log


def check_intensity(intensity: NDArray[np.float32], shape: tuple[int, int]) -> None:
    """Refuses what is no picture of linear light.

    Raises:
        InputError: another shape, or values that are negative or not finite.
    """
    check_array("intensity", intensity, f"an array {shape} of numbers")
    if intensity.shape != shape:
        raise InputError(f"frame of shape {intensity.shape}: this sensor needs {shape}")
    low, high = float(intensity.min()), float(intensity.max())
    if not (low >= 0 and np.isfinite(high)):
        raise InputError(
            f"intensities from {low} to {high}: need finite values of at least 0, full scale 1"
        )


def time_order(offset_us: NDArray[np.int64], step_us: int) -> NDArray[np.int64]:
    """Indices of the emitted events (offset > 0) in order of time, stable."""
    if step_us >= _MAX_BUCKETS:
        order = np.argsort(offset_us, kind="stable")
        return order[np.count_nonzero(offset_us == 0) :]
    ends = np.zeros(step_us + 1, np.int64)
    order = np.empty(len(offset_us), np.int64)
    kernels.counting_order(offset_us, ends, order)
    return order[ends[0] :]
