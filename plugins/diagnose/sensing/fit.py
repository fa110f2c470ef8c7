"""Fits the sensor model to a recording: all estimates, and the file that a simulation takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import Span, closed_up, joined, length_of, spans_of
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets.posed import EventSource
from eventsweep.emvs.errors import InputError, located
from eventsweep.plugins.diagnose.sensing.estimates import Estimate, refused
from eventsweep.plugins.diagnose.sensing.frames import Expected, FrameStack, frames_of
from eventsweep.plugins.diagnose.sensing.noise import hot_estimates, quiet_noise, refractory
from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents
from eventsweep.plugins.diagnose.sensing.thresholds import (
    THRESHOLDS,
    Pairs,
    pairs_of,
    threshold_estimates,
)
from eventsweep.sim.config import PixelConfig
from eventsweep.sim.sensor.sensor import Sensor

_POLARITIES = "contrast_threshold_pos", "contrast_threshold_neg"
_WITHOUT_FRAMES = [
    refused(
        name, unit, "events alone do not show how much the light changed; needs frames: three or "
        "more, of the events' size in pixels",
    )
    for name, unit in THRESHOLDS
]  # fmt: skip
# A search for thresholds that make as many events: steps, and how near is near enough.
_STEPS, _NEAR_ENOUGH, _LARGEST = 12, 0.01, 3.0
_MOST_EVENTS = 20_000_000
# What bounds the pairs' light before there is an estimate.
_USUAL_THRESHOLD = 0.2


@dataclass(frozen=True)
class SensorFit:
    """What a recording says of its sensor.

    Attributes:
        estimates: one per parameter.
        effective: thresholds that make as many events as there are when the frames drive the
            simulator, C+ and C-; empty where they are determined, or there are no frames.
        on_share: share of the events that brighten.
        noise_light: mean light, at which the rates of noise hold, 1 is full scale; NaN where there
            are no frames.
        pixels: the events.
        frames: None where there are none.
        pairs: of events near frames, likewise.
    """

    estimates: tuple[Estimate, ...]
    effective: tuple[float, ...]
    on_share: float
    noise_light: float
    pixels: PixelEvents
    frames: FrameStack | None
    pairs: Pairs | None

    def __getitem__(self, name: str) -> Estimate:
        return next(estimate for estimate in self.estimates if estimate.name == name)

    def values(self) -> dict[str, Any]:
        """As sensor.toml holds them: what was determined, and the sensor's table; bounds as 0."""
        known = {
            e.name: 0.0 if e.bounds else float(f"{e.value:.4g}")
            for e in self.estimates if not e.refused
        }  # fmt: skip
        top: dict[str, Any] = {name: known.pop(name) for name in _POLARITIES if name in known}
        if self.effective:
            top |= {n: float(f"{c:.4g}") for n, c in zip(_POLARITIES, self.effective, strict=True)}
        if "refractory_period_us" in known:
            top["refractory_period_us"] = round(known.pop("refractory_period_us"))
        shot = known.pop("shot_rate_hz", None)
        if shot is not None:
            known |= {"shot_rate_dark_hz": shot, "shot_rate_bright_hz": shot}
        return top | {"sensor": known}

    def config(self) -> PixelConfig:
        """The fitted sensor."""
        return PixelConfig(**self.values())


def fit_sensor(
    recording: Recording, camera: int = 0, span_us: tuple[int, int] | None = None
) -> SensorFit:
    """Fits the sensor of one camera of a recording, or of a part of it.

    Raises:
        InputError: no such camera, or no event.
    """
    recording.rig.check_camera(camera)
    first_us, last_us = span_us or recording.event_span_us(camera)
    sensor = recording.rig.cameras[camera]
    events = recording.events(camera, first_us, last_us + 1)
    if not len(events):
        raise InputError(f"{recording.name}: no event of camera {camera}; there is nothing to fit")
    pixels, spans = _pixels(events, (sensor.height_px, sensor.width_px), (first_us, last_us))
    frames = frames_of(recording, camera, (first_us, spans[-1][1] - 1))
    return fit_pixels(pixels, frames and frames.closed_up(spans))


def fit_stream(
    source: EventSource, size_px: tuple[int, int] | None, span_us: tuple[int, int]
) -> SensorFit:
    """Fits a sensor to a file's events alone; without a size it ends at the largest pixel.

    Raises:
        InputError: no event, or events that are not in the order of time.
    """
    events = source.between(span_us[0], span_us[1] + 1)
    if not len(events):
        raise InputError(f"{source.path}: no event between {span_us[0]} and {span_us[1]} µs")
    width_px, height_px = size_px or (int(events.x.max()) + 1, int(events.y.max()) + 1)
    with located(source.path):
        events = events.checked(width_px, height_px)
    return fit_pixels(_pixels(events, (height_px, width_px), span_us)[0], None)


def _pixels(
    events: Events, shape: tuple[int, int], span_us: tuple[int, int]
) -> tuple[PixelEvents, tuple[Span, ...]]:
    """By pixel, the first of very many, without the long silences; and what lies between those."""
    first_us, last_us = span_us
    if len(events) >= _MOST_EVENTS:
        events = events.slice(0, _MOST_EVENTS)
        last_us = min(last_us, int(events.t_us[-1]))
    spans = joined(spans_of(events.t_us), first_us, last_us + 1)
    events = replace(events, t_us=closed_up(events.t_us, spans))
    first_us = spans[0][0]
    return PixelEvents.of(events, shape, (first_us, first_us + length_of(spans) - 1)), spans


def fit_pixels(pixels: PixelEvents, frames: FrameStack | None) -> SensorFit:
    """Fits a sensor to events, and frames where there are some."""
    log_eps, threshold = PixelConfig().log_eps, _USUAL_THRESHOLD
    by_frames, pairs, expected = _WITHOUT_FRAMES, None, None
    if frames is not None:
        by_frames = threshold_estimates(pairs_of(pixels, frames, log_eps, threshold))
        known = [e.value for e in by_frames[:2] if not e.refused]
        threshold = float(np.mean(known)) if known else threshold
        expected = Expected(frames, threshold, log_eps)
    noise, rate_hz, light = quiet_noise(pixels, expected)
    silence = refractory(pixels, rate_hz)
    dead_us = 0.0 if silence.refused else silence.value
    if frames is not None:
        pairs = pairs_of(pixels, frames, log_eps, threshold, dead_us)
        by_frames = threshold_estimates(pairs)
    estimates = (*by_frames, silence, *noise, *hot_estimates(pixels, dead_us))
    fit = SensorFit(estimates, (), float(pixels.on.mean()), light, pixels, frames, pairs)
    if frames is None or not any(e.refused for e in by_frames[:2]):
        return fit
    return replace(fit, effective=effective_thresholds(pixels, frames, fit.values()))


def effective_thresholds(
    pixels: PixelEvents, frames: FrameStack, values: Mapping[str, Any]
) -> tuple[float, ...]:
    """C+ and C- that make as many events of each polarity as there are between the frames.

    Empty where none do: in a still scene thresholds have nothing to say.
    """
    inside = (pixels.t_us > frames.t_us[0]) & (pixels.t_us <= frames.t_us[-1])
    recorded = [np.count_nonzero(pixels.on & inside), np.count_nonzero(inside & ~pixels.on)]
    c = np.array([0.3, 0.3])
    for _ in range(_STEPS):
        made = counts_of(frames, {**values, **dict(zip(_POLARITIES, c.tolist(), strict=True))})
        off = np.log(np.maximum(made, 1) / np.maximum(recorded, 1))
        if np.abs(off).max() < _NEAR_ENOUGH:
            return tuple(c.tolist())
        if np.any(c >= _LARGEST):
            break
        c = np.clip(c * np.exp(0.8 * np.clip(off, -1, 1)), 0.01, _LARGEST)
    return ()


def counts_of(frames: FrameStack, values: Mapping[str, Any]) -> NDArray[np.int64]:
    """(2,) brighter and darker events of a sensor that watches the frames as a video."""
    height, width = frames.light.shape[1:]
    sensor = Sensor(0, width, height, PixelConfig(**values), 0)
    sensor.start(frames.light[0], int(frames.t_us[0]))
    counts = np.zeros(2, np.int64)
    for light, t_us in zip(frames.light[1:], frames.t_us[1:].tolist(), strict=True):
        p = sensor.step(light, t_us).events.p
        counts += np.bincount(1 - p, minlength=2)
    return counts
