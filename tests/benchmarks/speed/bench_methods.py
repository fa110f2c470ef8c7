"""What Algorithm 2 costs: `pytest tests/benchmarks/speed/bench_methods.py --benchmark-only`.

The sweep alone, on rays that are there already, on one thread; every figure is the best round, and
the rounds of all methods take turns. Time is the processor's: the wall's would feel others.
"""

import sys
import time
from itertools import pairwise

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.dsi.backprojection import Projected
from eventsweep.emvs.dsi.rays import event_rays
from eventsweep.emvs.dsi.sweep import sweep
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.mapper import targets_of
from eventsweep.emvs.methods import methods_by_name
from eventsweep.emvs.reference_view import ReferenceView, inverse_depth_planes
from point_world import edge_stream, sideways

EVENTS, PLANES, ROUNDS = 2_000_000, 20, 3
MOTION = sideways(0.2)
NAMES = (
    ("Alg1/H",), ("Focus/H",), ("all",), ("Alg2/AtHc@2",), ("Alg2/AtHc@4",), ("Alg2/HcAt@4",),
    ("Alg2/AtHc@16",), ("Alg2/AtHc@4", "Alg2/AcAt@4", "Alg2/HtHc@4", "Alg2/HcHt@4"),
)  # fmt: skip
SENSORS = {"346x260": (346, 260, 226.0), "1280x720": (1280, 720, 1050.0)}


def projected(camera, every_target):
    pose = MOTION.at(250_000)
    rays = {target.fusion.split: [] for targets in every_target for target in targets}
    counts = []
    for k in range(2):
        T_body_cam = np.eye(4)
        T_body_cam[0, 3] = 0.12 * k
        events = edge_stream(camera, MOTION, EVENTS, seed=k)
        whole = event_rays(events, camera, T_body_cam, MOTION, pose, camera)
        counts.append(whole.counts)
        for split, parts in rays.items():
            edges = split.edges(events.t_us, 0, 500_001)
            parts.extend(whole.part(int(i), int(j), whole.counts) for i, j in pairwise(edges))
    return Projected(rays, counts, np.empty((2, 0, 0), np.uint32))


@pytest.mark.parametrize("sensor", SENSORS)
def test_methods(benchmark, sensor, capsys):
    width, height, f = SENSORS[sensor]
    camera = Camera(width, height, f, f, (width - 1) / 2, (height - 1) / 2)
    view = ReferenceView(250_000, MOTION.at(250_000), camera, inverse_depth_planes(0.45, 4, PLANES))
    config = MapperConfig(planes=PLANES, threads=1)
    every_target = [targets_of(methods_by_name(names, 2), 2, config) for names in NAMES]
    rays = projected(camera, every_target)
    seconds = [[] for _ in NAMES]

    def one_round():
        for taken, targets in zip(seconds, every_target, strict=True):
            begin = time.process_time()
            sweep(rays, view, targets, config)
            taken.append(time.process_time() - begin)

    benchmark.pedantic(one_round, rounds=ROUNDS, warmup_rounds=1)
    best = [min(taken) for taken in seconds]
    with capsys.disabled():
        sys.stdout.write(f"\n{sensor}, 2 x {EVENTS // 1_000_000} M events, {PLANES} planes")
        for names, time_s in zip(NAMES, best, strict=True):
            sys.stdout.write(f"\n  {time_s:6.2f} s  {time_s / best[0]:5.2f}  {', '.join(names)}")
