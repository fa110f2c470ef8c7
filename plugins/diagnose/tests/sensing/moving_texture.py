"""A smooth texture that moves before a sensor: frames, events and pictures beside."""

import cv2
import numpy as np

from eventsweep.emvs.data.events import Events
from eventsweep.plugins.diagnose.sensing.frames import FrameStack
from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents
from eventsweep.sim.config import SimConfig
from eventsweep.sim.sensor.sensor import Sensor

SHAPE = 64, 80


def texture(seed, side=256):
    rng, f = np.random.default_rng(seed), np.fft.fftfreq(side)
    k = np.hypot(*np.meshgrid(f, f))
    spectrum = np.fft.fft2(rng.standard_normal((side, side))) * (k < 0.12)
    image = np.fft.ifft2(spectrum / np.maximum(k, 1 / side) ** 1.2).real
    return np.exp(-1.2 + 0.8 * image / image.std()).astype(np.float32)


def movie(seed=0, seconds=0.7, step_us=1000, speed_px_s=90.0, jump_px=0.0):
    """Times, µs, and (T, H, W) light; it may jump to and fro within a step, every 40 ms."""
    times_us = list(range(0, round(seconds * 1e6) + 1, step_us))
    picture, frames = texture(seed), []
    for t_us in times_us:
        s = t_us * 1e-6
        x, y = 40 + speed_px_s * s + 8 * np.sin(5 * s), 40 + 30 * np.sin(7 * s)
        x += jump_px * (t_us // 40_000 % 2)
        view = np.float32([[1, 0, x], [0, 1, y]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        frames.append(np.minimum(cv2.warpAffine(picture, view, SHAPE[::-1], flags=flags), 1))
    return times_us, frames


def recorded(times_us, frames, every=5, seed=0, **config):
    """Sorted events, and every n-th frame in 8 bits."""
    height, width = frames[0].shape
    sensor = Sensor(0, width, height, SimConfig(**config), seed)
    sensor.start(frames[0], times_us[0])
    steps = [sensor.step(f, t) for f, t in zip(frames[1:], times_us[1:], strict=True)]
    events = Events.concat([step.events for step in steps])
    light = (np.rint(255 * np.array(frames[::every])) / 255).astype(np.float32)
    usable = (light > 8 / 255) & (light < 247 / 255)
    stack = FrameStack(np.array(times_us[::every]), light, usable, True)
    return PixelEvents.of(events, (height, width), (times_us[0], times_us[-1])), stack
