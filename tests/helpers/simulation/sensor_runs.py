"""Frames for sensors, sensors run over them, and pictures of a frame camera."""

from itertools import pairwise

import numpy as np

from eventsweep.emvs.data.events import Events
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering.adaptive_sampling import adaptive_frames
from eventsweep.sim.sensor.esim import EventSimulator
from eventsweep.sim.sensor.frame_camera import DENSE_PX, Exposure
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


def mean_light(frames, start_us, end_us):
    """Mean (H, W) light over a span, of frames (t_us, light) that cover it."""
    exposing = Exposure(start_us, end_us)
    for before, after in pairwise(frames):
        exposing.add(before, after)
    return exposing.light()


def captured_light(renderer, motion, camera, start_us, config, exposure_us):
    """Mean (H, W) light of an exposure, from frames of its own."""
    limits = {"max_displacement_px": min(config.spacing_px, DENSE_PX)}
    dense = config.model_copy(update={"sampling": "linear", **limits})
    end_us = start_us + exposure_us
    taken = adaptive_frames(renderer, motion, [start_us, end_us], dense)
    frames = [(e.t_us, e.frames[camera].intensity) for e in taken]
    return mean_light(frames, start_us, end_us)


def grey_video(count, height, width):
    """A smooth random texture that swings to and fro, in 8 bits."""
    rng = np.random.default_rng(7)
    waves = rng.uniform(-0.5, 0.5, (12, 2))
    phase = rng.uniform(0, 2 * np.pi, 12)
    y, x = np.mgrid[:height, :width]
    frames = []
    for k in range(count):
        shift = 8 * np.sin(2 * np.pi * k / 80)
        angle = waves[:, 0, None, None] * (x + shift) + waves[:, 1, None, None] * y
        picture = np.sin(angle + phase[:, None, None]).sum(axis=0)
        frames.append(np.rint(127.5 + 127.5 * np.tanh(picture / 4)) / 255)
    return np.asarray(frames, np.float32)
