"""What the rivals cost: `pytest tests/benchmarks/speed/bench_baselines.py --benchmark-only`.

Nanoseconds per event of the window, of both cameras, on one thread, the best of the rounds;
sensors of two sizes and windows of two lengths show how each grows. Time is the processor's.
"""

import sys
import time

import cv2
import pytest

from eventsweep.emvs import baselines
from eventsweep.emvs.baselines import esvo, gts
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.reference_view import reference_view
from eventsweep.emvs.windows import choose_window
from point_world import Recorded, edge_stream, fronto_parallel, sideways, stereo_rig

EVENTS, ROUNDS = 500_000, 3
PLANE = MapperConfig(min_depth_m=0.5, max_depth_m=4.0, planes=25, border_px=0)
SENSORS = {"346x260": (346, 260, 226.0), "640x480": (640, 480, 420.0)}


def recording(sensor, events):
    width, height, f = SENSORS[sensor]
    camera = Camera(width, height, f, f, (width - 1) / 2, (height - 1) / 2)
    motion = sideways(0.2)
    streams = tuple(edge_stream(camera, motion, events, seed=k) for k in range(2))
    return Recorded(stereo_rig(camera), motion, streams, (0.5, 4.0))


def best_ns(run, events):
    taken = []
    for _ in range(ROUNDS + 1):
        begin = time.process_time()
        run()
        taken.append(time.process_time() - begin)
    return 1e9 * min(taken[1:]) / events


def write(line):
    sys.stdout.write(f"\n  {line}")


# SGM only, whose cost does not depend on what matches. The two cameras' edges are drawn apart, so
# ESVO rightly says that no two estimates agree: `test_a_window` has a plane that both see.
@pytest.mark.parametrize("name", [n for n in baselines.GROUPS["baselines"] if n.startswith("SGM")])
def test_rivals(benchmark, name, capsys):
    rival, config = baselines.BY_NAME[name], MapperConfig(threads=1)
    cv2.setNumThreads(1)
    rows = []
    for sensor in SENSORS:
        for events in (EVENTS // 2, EVENTS):
            made = recording(sensor, events)
            window = choose_window(made, config)
            view = reference_view(made, config, window.t_ref_us)

            def run(made=made, window=window, view=view):
                rival.estimate(made, window, view, config)

            rows.append(f"{sensor}, 2 x {events // 1000} k: {best_ns(run, 2 * events):7.0f} ns")
    benchmark.pedantic(run, rounds=1)
    with capsys.disabled():
        write(f"{name:12s} {' | '.join(rows)}")


@pytest.mark.parametrize("points", [2000, 6000])
@pytest.mark.parametrize("function", [esvo.estimate, esvo.estimate_window, gts.estimate])
def test_a_window(benchmark, function, points, capsys):
    recording = fronto_parallel(1.3, points=points)
    window = choose_window(recording, PLANE)
    view = reference_view(recording, PLANE, window.t_ref_us)
    events = sum(len(s) for s in recording.streams)
    benchmark.pedantic(function, (recording, window, view, PLANE), rounds=3, warmup_rounds=1)
    begin = time.process_time()
    function(recording, window, view, PLANE)
    taken_ns = 1e9 * (time.process_time() - begin)
    with capsys.disabled():
        name = f"{function.__module__}.{function.__name__}"
        sys.stdout.write(f"\n  {name}: {events} events, {taken_ns / events:.0f} ns each")
