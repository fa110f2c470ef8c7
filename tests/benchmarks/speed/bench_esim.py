"""Benchmarks of the simulator's loops; not collected by default.

Run: pytest tests/benchmarks/speed/bench_esim.py --benchmark-only -s
The event simulator's number is per pixel and interval on one thread: below 6.7, with a camera per
core, means 3e8 pixel-intervals per second on two cores.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering.adaptive_sampling import largest_displacement_px
from eventsweep.sim.sensor.esim import EventSimulator
from eventsweep.sim.sensor.sensor import Sensor
from eventsweep.sim.sensor_presets import SensorConfig

SIZES = {"346x260": (346, 260), "640x480": (640, 480), "1280x720": (1280, 720)}
STEPS = 40


def drifting_texture(width_px, height_px):
    """Frames of a texture that moves 0.45 px at a time; 2 % of the pixels fire per frame."""
    noise = np.random.default_rng(0).random((height_px, width_px + 60), np.float32)
    texture = np.clip((cv2.GaussianBlur(noise, (0, 0), 2.5) - 0.5) * 2.0 + 0.5, 0.05, 0.95)
    centre_x, centre_y = width_px / 2 + 20, height_px / 2
    return [
        cv2.getRectSubPix(texture, (width_px, height_px), (centre_x + 0.45 * k, centre_y))
        for k in range(STEPS + 1)
    ]


@pytest.mark.parametrize("size", SIZES)
def test_event_simulator(benchmark, size):
    width_px, height_px = SIZES[size]
    frames = drifting_texture(width_px, height_px)

    def started():
        simulator = EventSimulator(width_px, height_px, SimConfig())
        simulator.start(frames[0], 0)
        return (simulator,), {}

    def run(simulator):
        return sum(len(simulator.step(f, 1000 * k)) for k, f in enumerate(frames[1:], 1))

    events = benchmark.pedantic(run, setup=started, rounds=15, warmup_rounds=2)
    pixels = STEPS * width_px * height_px
    benchmark.extra_info["events_per_pixel"] = round(events / pixels, 3)
    benchmark.extra_info["ns_per_pixel"] = round(1e9 * benchmark.stats.stats.min / pixels, 2)
    print(f"\n{size}: {benchmark.extra_info}")  # noqa: T201 - the benchmark's result


@pytest.mark.parametrize("preset", ["ideal", "davis346", "gen4"])
@pytest.mark.parametrize("size", SIZES)
def test_sensor(benchmark, size, preset):
    """Everything on but `ideal`: 20 ns per pixel and interval are 1e8 per second on two cores."""
    width_px, height_px = SIZES[size]
    frames = drifting_texture(width_px, height_px)
    config = SimConfig(sensor=SensorConfig(preset=preset))

    def started():
        sensor = Sensor(0, width_px, height_px, config, 0)
        sensor.start(frames[0], 0)
        return (sensor,), {}

    def run(sensor):
        return sum(len(sensor.step(f, 1000 * k)) for k, f in enumerate(frames[1:], 1))

    events = benchmark.pedantic(run, setup=started, rounds=5, warmup_rounds=1)
    pixels = STEPS * width_px * height_px
    benchmark.extra_info["events_per_pixel"] = round(events / pixels, 3)
    benchmark.extra_info["ns_per_pixel"] = round(1e9 * benchmark.stats.stats.min / pixels, 2)
    print(f"\n{preset} {size}: {benchmark.extra_info}")  # noqa: T201 - the benchmark's result


@pytest.mark.parametrize("size", SIZES)
def test_displacement(benchmark, size):
    width_px, height_px = SIZES[size]
    camera = Camera(
        width_px, height_px, 0.8 * width_px, 0.8 * width_px, width_px / 2, height_px / 2
    )
    rig = Rig("one", (camera,), (np.eye(4),))
    depths_m = [np.random.default_rng(0).uniform(0.5, 4, (height_px, width_px)).astype(np.float32)]
    moved = np.eye(4)
    moved[0, 3] = 0.001
    benchmark(largest_displacement_px, rig, depths_m, np.eye(4), moved)
    pixels = width_px * height_px
    benchmark.extra_info["ns_per_pixel"] = round(1e9 * benchmark.stats.stats.min / pixels, 2)
    print(f"\n{size}: {benchmark.extra_info}")  # noqa: T201 - the benchmark's result
