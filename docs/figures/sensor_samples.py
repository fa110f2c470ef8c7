"""Short runs of a sensor over given frames, and what to count in them; for the pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.sim.config import SimConfig
from eventsweep.sim.sensor.sensor import Sensor
from eventsweep.sim.sensor_presets import SensorConfig

Frame = NDArray[np.float32]
EPS = 1e-4
"""`log_eps` of the runs."""


def run(
    frames: Sequence[Frame], times_us: Sequence[int], refractory_us: int = 0, **sensor: Any
) -> tuple[Events, NDArray[np.uint8], Sensor]:
    """Events and labels of a sensor with thresholds of 0.2."""
    config = SimConfig(
        refractory_period_us=refractory_us, log_eps=EPS, sensor=SensorConfig(**sensor)
    )
    height, width = frames[0].shape
    made = Sensor(0, width, height, config, 0)
    made.start(frames[0], times_us[0])
    steps = [made.step(f, t) for f, t in zip(frames[1:], times_us[1:], strict=True)]
    made.finish()
    labels = np.concatenate([step.label for step in steps])
    return Events.concat([step.events for step in steps]), labels, made


def flat(level: float, shape: tuple[int, int]) -> Frame:
    """A frame of one intensity."""
    return np.full(shape, level, np.float32)


def per_pixel(events: Events, shape: tuple[int, int]) -> NDArray[np.int64]:
    """(P,) how many events each pixel has."""
    return np.bincount(events.y.astype(int) * shape[1] + events.x, minlength=shape[0] * shape[1])


def gaps_us(events: Events) -> NDArray[np.int64]:
    """Times from event to event of the same pixel, all pixels together."""
    pixel = events.y.astype(int) * 65536 + events.x
    order = np.lexsort((events.t_us, pixel))
    gaps: NDArray[np.int64] = np.diff(events.t_us[order])[np.diff(pixel[order]) == 0]
    return gaps
