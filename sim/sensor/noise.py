"""Events without a cause in the scene: shot noise and hot pixels, Poisson processes in time.

A step draws how many events there are, then where and when; shot noise is thinned by the intensity
at its own pixel and moment. So the rates hold exactly for any interval between frames.

Noise that fires a pixel resets it: its reference becomes the level with the noise in it, and when
the noise is gone the level is a threshold off, and the opposite event follows (Graca and Delbruck,
"Shining light on the DVS pixel", CVPRW 2023). After such a pair the reference is where it was, so
events of the scene do not move.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.sim.sensor.labels import Label
from eventsweep.sim.sensor.pixels import Batch, Randomness, Use, rate_factors
from eventsweep.sim.sensor_presets import SensorParameters

Light = NDArray[np.float32]


class Noise:
    """Shot noise and hot pixels of one camera."""

    def __init__(self, number: int, parameters: SensorParameters, randomness: Randomness) -> None:
        self._number, self._parameters, self._randomness = number, parameters, randomness
        count = round(parameters.hot_pixel_fraction * number)
        generator = randomness.at(Use.HOT_PIXELS)
        chosen = generator.choice(number, count, replace=False)
        self.hot_pixels: NDArray[np.int32] = np.sort(chosen).astype(np.int32)
        """Raster indices."""
        self._weights: NDArray[np.float64] | None = None
        if parameters.noise_spread_decades:
            self._weights = np.cumsum(rate_factors(number, parameters, randomness))
        self._returns = Batch.empty()

    def step(self, light_before: Light, light_now: Light, before_us: int, t_us: int) -> Batch:
        """Noise events in (before, now], in no order, for intensity (P,) linear in between."""
        shot = self._shot(light_before, light_now, before_us, t_us - before_us)
        return shot.joined(self._hot(before_us, t_us - before_us))

    def discard(self) -> int:
        """Forgets second events of pairs that are still to come; returns how many."""
        left, self._returns = len(self._returns), Batch.empty()
        return left

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything that later events depend on."""
        return self._returns.columns()

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Goes on from `state`."""
        self._returns = Batch.from_columns(state)

    def _shot(self, light_before: Light, light_now: Light, before_us: int, step_us: int) -> Batch:
        dark_hz = self._parameters.shot_rate_dark_hz
        bright_hz = self._parameters.shot_rate_bright_hz
        most_hz = max(dark_hz, bright_hz)
        if most_hz == 0:
            return Batch.empty()
        rng = self._randomness.at(Use.SHOT_EVENTS, before_us)
        pair_hz = self._parameters.shot_pair_rate_hz
        pixels = self._number if self._weights is None else float(self._weights[-1])
        # Pairs come at half the rate of their events.
        count = rng.poisson(most_hz * pixels * step_us * 1e-6 / (2 if pair_hz else 1))
        pixel = self._noisy_pixels(rng, count)
        share, level = rng.random((2, count))
        light = light_before[pixel] + share * (light_now[pixel] - light_before[pixel])
        rate_hz = dark_hz + (bright_hz - dark_hz) * np.clip(light, 0, 1)
        p = rng.integers(2, size=count, dtype=np.uint8)
        kept = level * most_hz < rate_hz
        first = _batch(pixel[kept], share[kept], p[kept], Label.SHOT, before_us, step_us)
        return self._with_returns(first, rng, before_us + step_us) if pair_hz else first

    def _noisy_pixels(self, rng: np.random.Generator, count: int) -> NDArray[np.int32]:
        if self._weights is None:
            return rng.integers(self._number, size=count, dtype=np.int32)
        drawn = rng.random(count) * self._weights[-1]
        return np.asarray(np.searchsorted(self._weights, drawn, side="right"), np.int32)

    def _with_returns(self, first: Batch, rng: np.random.Generator, t_us: int) -> Batch:
        """These events and what follows up to `t_us` of them and of earlier ones."""
        mean_us = 1e6 / self._parameters.shot_pair_rate_hz
        delay_us = 1 + rng.exponential(mean_us, len(first)).astype(np.int64)
        second = Batch(first.pixel, first.t_us + delay_us, 1 - first.p, first.label)
        coming = self._returns.joined(second)
        due = coming.t_us <= t_us
        self._returns = coming.take(~due)
        return first.joined(coming.take(due))

    def _hot(self, before_us: int, step_us: int) -> Batch:
        rate_hz = self._parameters.hot_pixel_rate_hz
        if not (rate_hz and len(self.hot_pixels)):
            return Batch.empty()
        rng = self._randomness.at(Use.HOT_EVENTS, before_us)
        count = rng.poisson(rate_hz * len(self.hot_pixels) * step_us * 1e-6)
        pixel = self.hot_pixels[rng.integers(len(self.hot_pixels), size=count)]
        # A hot pixel's junction leaks: it says "brighter".
        p = np.ones(count, np.uint8)
        return _batch(pixel, rng.random(count), p, Label.HOT, before_us, step_us)


def _batch(
    pixel: NDArray[np.int32], share: NDArray[np.float64], p: NDArray[np.uint8], label: Label,
    before_us: int, step_us: int,
) -> Batch:  # fmt: skip
    offset_us = 1 + np.floor(share * step_us).astype(np.int64)
    labels = np.full(len(pixel), label, np.uint8)
    return Batch(pixel, before_us + np.minimum(offset_us, step_us), p, labels)
