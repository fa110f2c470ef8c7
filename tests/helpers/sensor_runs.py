"""Frames for sensors, and sensors run over them."""

import numpy as np

from eventsweep.emvs.data.events import Events
from eventsweep.sim.config import SimConfig
from eventsweep.sim.sensor.esim import EventSimulator
from eventsweep.sim.sensor.labels import LabelledEvents
from eventsweep.sim.sensor.sensor import Sensor


def config(refractory_us=0, c_pos=0.2, c_neg=0.2, log_eps=0.02, **sensor):
    return SimConfig(
        contrast_threshold_pos=c_pos, contrast_threshold_neg=c_neg,
        refractory_period_us=refractory_us, log_eps=log_eps, sensor=sensor,
    )  # fmt: skip


def run(frames, times_us, config, seed=0, camera=0, **options):
    """All labelled events, and the sensor, finished."""
    height, width = frames[0].shape
    sensor = Sensor(camera, width, height, config, seed, **options)
    sensor.start(frames[0], times_us[0])
    steps = [sensor.step(f, t) for f, t in zip(frames[1:], times_us[1:], strict=True)]
    sensor.finish()
    return joined(steps), sensor


def run_ideal(frames, times_us, config):
    """The events of every interval, of the plain event model."""
    simulator = EventSimulator(frames.shape[2], frames.shape[1], config)
    simulator.start(frames[0], times_us[0])
    return [simulator.step(f, t) for f, t in zip(frames[1:], times_us[1:], strict=True)]


def joined(steps):
    labels = [step.label for step in steps]
    return LabelledEvents(Events.concat([s.events for s in steps]), np.concatenate(labels))


def constant(level, shape, times_us):
    return [np.full(shape, level, np.float32)] * len(times_us)


def irregular_times_us(duration_us, seed=0):
    """Frame times with gaps from 20 µs to 10 ms."""
    rng = np.random.default_rng(seed)
    gaps_us = np.exp(rng.uniform(np.log(20), np.log(10_000), 1 + duration_us // 1500))
    times_us = np.concatenate([[0], np.cumsum(np.rint(gaps_us).astype(int))])
    return [*times_us[times_us < duration_us].tolist(), duration_us]


def moving_bars(count, shape=(12, 16)):
    x = np.arange(shape[1]) + 0.7 * np.arange(count)[:, None]
    rows = 0.5 + 0.45 * np.sin(0.9 * x)
    return np.repeat(rows[:, None], shape[0], 1).astype(np.float32)


def rows_of(labelled):
    e = labelled.events
    return list(zip(*(a.tolist() for a in (e.t_us, e.y, e.x, e.p, labelled.label)), strict=True))


def ideal_rows(steps):
    """The rows of what `run_ideal` gave."""
    e = Events.concat(steps)
    return list(zip(*(a.tolist() for a in (e.t_us, e.y, e.x, e.p)), strict=True))


def counts_per_pixel(events, shape):
    flat = events.y.astype(int) * shape[1] + events.x
    return np.bincount(flat, minlength=shape[0] * shape[1])


def gaps_of(events, shape):
    flat = events.y.astype(int) * shape[1] + events.x
    order = np.lexsort([events.t_us, flat])
    gaps_us = np.diff(events.t_us[order])
    return gaps_us[np.diff(flat[order]) == 0]
