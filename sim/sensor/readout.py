"""From a pixel's event to its time stamp: latency, the row arbiter, the clock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.sim.sensor import readout_kernels as kernels
from eventsweep.sim.sensor.esim import NEVER_US
from eventsweep.sim.sensor.pixels import Batch
from eventsweep.sim.sensor.random_streams import Randomness, Use
from eventsweep.sim.sensor_presets import SensorParameters


class Latency:
    """Delays events by a gamma-distributed time whose mean falls with intensity.

    Events that come out after the last frame are kept for the steps to come.
    """

    def __init__(self, number: int, parameters: SensorParameters, randomness: Randomness) -> None:
        self._parameters, self._randomness = parameters, randomness
        self._last_us = np.full(number, NEVER_US, np.int64)
        self._pending = Batch.empty()

    def step(self, events: Batch, light: NDArray[np.float32], before_us: int, t_us: int) -> Batch:
        """Takes events in order of time and intensity (P,); returns requests up to `t_us`."""
        requested_us = events.t_us + self._delay_us(light[events.pixel], before_us)
        kernels.in_turn(events.pixel, requested_us, self._last_us)
        delayed = Batch(events.pixel, requested_us, events.p, events.label)
        all_ = self._pending.joined(delayed).in_time_order()
        ready = int(np.searchsorted(all_.t_us, t_us, side="right"))
        self._pending = all_.take(slice(ready, None))
        return all_.take(slice(ready))

    def discard(self) -> int:
        """Forgets what has not come out; returns how many events that were."""
        left, self._pending = len(self._pending), Batch.empty()
        return left

    def _delay_us(self, light: NDArray[np.float32], before_us: int) -> NDArray[np.int64]:
        p = self._parameters
        delay_us = p.latency_us * (1 + p.dark_level) / (light.astype(float) + p.dark_level)
        if p.latency_jitter:
            rng = self._randomness.at(Use.LATENCY, before_us)
            variance = p.latency_jitter**2
            delay_us *= rng.gamma(1 / variance, variance, len(light))
        return np.rint(delay_us).astype(np.int64)

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything that later events depend on."""
        return {"last_us": self._last_us.copy(), **self._pending.columns()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Goes on from `state`."""
        self._last_us = state["last_us"].copy()
        self._pending = Batch.from_columns(state)


class Arbiter:
    """Passes requests on row by row, no faster than the read-out can."""

    def __init__(self, shape: tuple[int, int], parameters: SensorParameters) -> None:
        self._shape = shape
        self._row_us = _period_us(parameters.readout_rows_per_s)
        self._event_us = _period_us(parameters.readout_events_per_s)
        self._capacity = parameters.readout_queue_events
        self._waiting, self._free_us = Batch.empty(), float(NEVER_US)

    def step(self, requests: Batch, t_us: int) -> tuple[Batch, int]:
        """Takes requests up to `t_us`; returns events sent until then, and how many were lost."""
        all_ = self._waiting.joined(requests)
        number = len(all_)
        served, served_us = np.empty(number, np.int64), np.empty(number, np.int64)
        fate = np.empty(number, np.uint8)
        links = np.empty((3, max(number, self._shape[0])), np.int64)
        row = all_.pixel // np.int32(self._shape[1])
        n, self._free_us = kernels.arbitrate(
            row, all_.t_us, len(self._waiting), self._free_us, t_us, self._row_us,
            self._event_us, self._capacity, links, served, served_us, fate,
        )  # fmt: skip
        self._waiting = all_.take(fate == kernels.WAITING)
        sent = all_.take(served[:n])
        lost = int(np.count_nonzero(fate == kernels.DROPPED))
        return Batch(sent.pixel, served_us[:n], sent.p, sent.label), lost

    def discard(self) -> int:
        """Forgets what has not come out; returns how many events that were."""
        left, self._waiting = len(self._waiting), Batch.empty()
        return left

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything that later events depend on."""
        return {"free_us": np.array(self._free_us), **self._waiting.columns()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Goes on from `state`."""
        self._free_us, self._waiting = float(state["free_us"]), Batch.from_columns(state)


def _period_us(rate_hz: float) -> float:
    return 1e6 / rate_hz if rate_hz else 0.0
