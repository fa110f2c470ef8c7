"""Imperfect pixels: what the comparators of one camera say between two frames.

Randomness depends on what it is for and when, never on how the work was cut up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.sim.sensor import pixels_kernels as kernels
from eventsweep.sim.sensor.esim import log_intensity, time_order
from eventsweep.sim.sensor.esim_kernels import PIXEL, Own, emit, find
from eventsweep.sim.sensor.pixels_kernels import low_pass
from eventsweep.sim.sensor_presets import SensorParameters

# Mismatch never takes a threshold below this share of its nominal value.
_LEAST_THRESHOLD = 0.1


class Use(IntEnum):
    """What numbers are drawn for; every use has numbers of its own."""

    THRESHOLDS = 0
    LEAK = 1
    HOT_PIXELS = 2
    SHOT_EVENTS = 3
    HOT_EVENTS = 4
    LATENCY = 5
    NOISE_SPREAD = 6


class Randomness:
    """Generators of one camera, counter-based (Philox) and keyed by seed and camera.

    Salmon, Moraes, Dror, Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3", SC 2011.
    """

    def __init__(self, seed: int, camera: int) -> None:
        if seed < 0 or camera < 0:
            raise InputError(f"seed {seed}, camera {camera}: both must be 0 or greater")
        self._key = np.random.SeedSequence([seed, camera]).generate_state(2, np.uint64)

    def at(self, use: Use, t_us: int = 0) -> np.random.Generator:
        """Numbers for the step that starts at `t_us`, or those that are drawn once per camera."""
        counter = np.array([0, 0, int(use), t_us % 2**64], np.uint64)
        return np.random.Generator(np.random.Philox(key=self._key, counter=counter))


@dataclass(frozen=True, slots=True)
class Batch:
    """Events by pixel index, with their causes; a view of no order in particular.

    Attributes:
        pixel: (N,) int32 raster index.
        t_us: (N,) int64 times, µs.
        p: (N,) uint8 polarity.
        label: (N,) uint8 `Label`.
    """

    pixel: NDArray[np.int32]
    t_us: NDArray[np.int64]
    p: NDArray[np.uint8]
    label: NDArray[np.uint8]

    @classmethod
    def empty(cls) -> Batch:
        """No events."""
        byte = np.empty(0, np.uint8)
        return cls(np.empty(0, np.int32), np.empty(0, np.int64), byte, byte)

    @classmethod
    def from_columns(cls, columns: Mapping[str, NDArray[Any]]) -> Batch:
        """A copy of what `columns` gave."""
        return cls(*(columns[f.name].copy() for f in fields(cls)))

    def columns(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, for states."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __len__(self) -> int:
        return len(self.t_us)

    def take(self, chosen: NDArray[Any] | slice) -> Batch:
        """The events of an index, mask or slice."""
        return Batch(*(getattr(self, f.name)[chosen] for f in fields(self)))

    def joined(self, *others: Batch) -> Batch:
        """These events, then the others'."""
        parts = [part for part in (self, *others) if len(part)]
        if len(parts) < 2:
            return parts[0] if parts else self
        return Batch(*(np.concatenate([getattr(b, f.name) for b in parts]) for f in fields(self)))

    def in_time_order(self) -> Batch:
        """Sorted by time, stable."""
        if len(self) < 2:
            return self
        first_us = int(self.t_us.min()) - 1
        offset_us = self.t_us - first_us
        return self.take(time_order(offset_us, int(offset_us.max())))


def rate_factors(
    number: int, parameters: SensorParameters, randomness: Randomness
) -> NDArray[np.float64]:
    """(P,) how many times the median pixel's noise each pixel has, log-normal, after v2e."""
    if not parameters.noise_spread_decades:
        return np.ones(number)
    normal = randomness.at(Use.NOISE_SPREAD).standard_normal(number)
    return np.asarray(10.0 ** (parameters.noise_spread_decades * normal))


class Pixels:
    """Photoreceptor, leak and comparator of every pixel (H, W) of one camera."""

    _KEPT = ("log", "frame", "inner", "light", "leaked", "speed", "leaked_last", "reference")

    _light_now: NDArray[np.float64]
    _leaked_now: NDArray[np.float64]

    def __init__(
        self,
        shape: tuple[int, int],
        thresholds: tuple[float, float],
        log_eps: float,
        parameters: SensorParameters,
        randomness: Randomness,
    ) -> None:
        self._shape, self._log_eps, self._parameters = shape, log_eps, parameters
        self._randomness, number = randomness, shape[0] * shape[1]
        self.c_pos, self.c_neg = self._drawn_thresholds(thresholds, number)
        key = randomness.at(Use.LEAK).integers(2**64, dtype=np.uint64)
        self._leak_key = np.uint64(key)
        self._factors = rate_factors(number, parameters, randomness)
        self._allocate(number)

    def start(self, intensity: NDArray[np.float32]) -> None:
        """Settles on the first frame."""
        self._log = log_intensity(intensity, self._shape, self._log_eps)
        self._frame = np.array(intensity, np.float32).ravel()
        self._light = self._log.astype(np.float64)
        self._inner, self._reference = self._light.copy(), self._light.copy()
        self._memory = np.zeros(self._log.size, PIXEL)
        self._memory["first_log"] = self._log
        number = self._log.size
        self._leaked, self._leaked_last = np.zeros(number), np.zeros(number)
        self._speed = np.zeros(number)
        if self._parameters.leaks:
            self._start_leak()

    def step(self, intensity: NDArray[np.float32], before_us: int, t_us: int) -> Batch:
        """Crossings between the frame before and this one, in raster order, causes named."""
        log = log_intensity(intensity, self._shape, self._log_eps)
        frame = np.array(intensity, np.float32).ravel()
        step_us = t_us - before_us
        self._respond(log, frame, step_us)
        self._leak_on(frame, step_us)
        n = find(
            self._light_now, 0.0, 0.0, self._own, self._reference, self._memory,
            self._fired, self._crossings,
        )  # fmt: skip
        events = self._emit(n, before_us, step_us) if n else Batch.empty()
        self.frame_before, self._log, self._frame = self._frame, log, frame
        self._light, self._light_now = self._light_now, self._light
        if self._parameters.leaks:
            self._leaked, self._leaked_now = self._leaked_now, self._leaked
        return events

    @property
    def frame(self) -> NDArray[np.float32]:
        """(P,) intensity of the last frame; `frame_before` has the one before."""
        return self._frame

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything that later events depend on."""
        return {name: getattr(self, f"_{name}") for name in (*self._KEPT, "memory")}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Goes on from `state`."""
        for name in (*self._KEPT, "memory"):
            setattr(self, f"_{name}", state[name].copy())

    def _allocate(self, number: int) -> None:
        self._fired, self._crossings = np.empty((2, number), np.int32)
        self._light_now, self._leaked_now = np.empty(number), np.zeros(number)

    def _drawn_thresholds(
        self, nominal: tuple[float, float], number: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        normal = self._randomness.at(Use.THRESHOLDS).standard_normal((2, number))
        drawn = np.asarray(nominal)[:, None] + self._parameters.threshold_sigma * normal
        c_pos, c_neg = np.maximum(drawn, _LEAST_THRESHOLD * np.asarray(nominal)[:, None])
        return c_pos, c_neg

    def _start_leak(self) -> None:
        """Pixels have been on for long: they are anywhere on their way to the next leak event."""
        number = self._log.size
        self._leaked = self._randomness.at(Use.LEAK).random((2, number))[1]
        self._leaked_last = self._leaked.copy()
        jitter = self._parameters.leak_jitter
        kernels.leak_speeds(self._leak_key, self._leak_base_hz, jitter, self._speed)

    def _respond(self, log: NDArray[np.float32], frame: NDArray[np.float32], step_us: int) -> None:
        p = self._parameters
        if not p.bandwidth_hz:
            self._light_now[:] = log
            return
        low_pass(
            self._log, log, self._frame, frame, 2e-6 * np.pi * p.bandwidth_hz * step_us,
            p.dark_level, p.bandwidth_order, self._inner, self._light, self._light_now,
        )  # fmt: skip

    @property
    def _own(self) -> Own:
        leaked = self._leaked, self._leaked_now, self._leaked_last
        return Own(self.c_pos, self.c_neg, *leaked)

    @property
    def _leak_base_hz(self) -> float:
        """The rate that `_pace` counts in."""
        return self._parameters.leak_rate_hz or self._parameters.leak_light_hz

    def _pace(self, frame: NDArray[np.float32]) -> NDArray[np.float64]:
        """(P,) leak of each pixel in the interval that ends with a frame, over the base rate."""
        p = self._parameters
        if not p.leak_light_hz:
            return self._factors
        light = 0.5 * (self._frame.astype(np.float64) + frame)
        return self._factors * (p.leak_rate_hz + p.leak_light_hz * light) / self._leak_base_hz

    def _leak_on(self, frame: NDArray[np.float32], step_us: int) -> None:
        if self._parameters.leaks:
            kernels.leak(
                self._leak_key, self._leak_base_hz, self._parameters.leak_jitter, step_us * 1e-6,
                self._pace(frame), self._speed, self._leaked, self._leaked_now,
            )  # fmt: skip

    def _emit(self, n: int, before_us: int, step_us: int) -> Batch:
        fired, crossings = self._fired[:n], self._crossings[:n]
        total = int(np.abs(crossings).sum())
        pixel, offset_us = np.empty(total, np.int32), np.empty(total, np.int64)
        p, label = np.empty(total, np.uint8), np.empty(total, np.uint8)
        emit(
            self._light, self._light_now, 0.0, 0.0, self._own, self._reference, self._memory,
            fired, crossings, step_us, pixel, offset_us, p, label,
        )  # fmt: skip
        return Batch(pixel, before_us + offset_us, p, label)
