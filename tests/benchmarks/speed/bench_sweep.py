"""What the mapper's loops cost: `pytest tests/benchmarks/speed/bench_sweep.py --benchmark-only`.

Events of edge points at many depths with 10 % noise, seen by a camera that moves sideways, on one
thread. Each figure is the best round: on a shared machine the others measure the neighbours.
"""

import sys

import numpy as np
import pytest

from eventsweep.emvs.dsi import voting as sweep_module
from eventsweep.emvs.dsi.fusion import MEANS
from eventsweep.emvs.dsi.maxima import RunningMaxima
from eventsweep.emvs.dsi.rays import BAND_ROWS, grouped_by_rows, knots, rays_between
from eventsweep.emvs.dsi.voting import Scratch, batch_planes
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.methods import methods_by_name
from eventsweep.emvs.reference_view import inverse_depth_planes
from eventsweep.emvs.utils.runtime import use_threads
from point_world import edge_stream, sideways

PAPER = (*(f"Alg1/{name}" for name in MEANS), "EMVS/cam0", "EMVS/cam1")
EVENTS = 1_000_000
PLANES = 20
RHO = inverse_depth_planes(0.45, 4, PLANES)
MOTION = sideways(0.2)
SENSORS = {
    "346x260": (346, 260, 226.0),
    "640x480": (640, 480, 553.0),
    "1280x720": (1280, 720, 1050),
}


@pytest.fixture(params=SENSORS)
def camera(request):
    width, height, f = SENSORS[request.param]
    return Camera(width, height, f, f, (width - 1) / 2, (height - 1) / 2)


@pytest.fixture(autouse=True)
def _one_thread():
    use_threads(1)
    yield
    use_threads(0)


def cast_rays(camera, n=EVENTS, band_rows=BAND_ROWS):
    events = edge_stream(camera, MOTION, n)
    rays = rays_between(events, camera, np.eye(4), knots(MOTION, MOTION.at(250_000)), camera)
    if band_rows is None:
        return rays
    return grouped_by_rows(rays, RHO[PLANES // 2], camera.height_px, band_rows)


def report(capsys, benchmark, what, units):
    best_ns = benchmark.stats.stats.min / units * 1e9
    benchmark.extra_info["ns"] = best_ns
    with capsys.disabled():
        sys.stdout.write(f"\n{what}: {best_ns:.2f} ns")


@pytest.mark.parametrize("events", [1_000_000, 4_000_000], ids=["1M", "4M"])
def test_sweep(benchmark, camera, events, capsys):
    rays = cast_rays(camera, events)
    step = batch_planes(PLANES, 1, camera.width_px * camera.height_px)
    scratch = Scratch(1, step, camera.width_px, camera.height_px)

    def sweep():
        for first in range(0, PLANES, step):
            scratch.cast(0, rays, RHO[first : first + step])

    benchmark.pedantic(sweep, rounds=9, warmup_rounds=1)
    size = f"{camera.width_px}x{camera.height_px}, {events // 1_000_000} M events"
    report(capsys, benchmark, f"sweep {size}, per event and plane", len(rays) * PLANES)


@pytest.mark.parametrize("planes_per_pass", [1, 2, 4, 8])
def test_planes_per_pass(benchmark, camera, planes_per_pass, monkeypatch, capsys):
    monkeypatch.setattr(sweep_module, "PASS_PLANES", planes_per_pass)
    rays = cast_rays(camera, 4_000_000)
    scratch = Scratch(1, planes_per_pass, camera.width_px, camera.height_px)

    def sweep():
        for first in range(0, PLANES, planes_per_pass):
            scratch.cast(0, rays, RHO[first : first + planes_per_pass])

    benchmark.pedantic(sweep, rounds=3, warmup_rounds=1)
    size = f"{camera.width_px}x{camera.height_px}, {planes_per_pass} planes per pass"
    report(capsys, benchmark, f"sweep {size}, per event and plane", len(rays) * PLANES)


@pytest.mark.parametrize("band_rows", [None, 1, 4, 8, 16, 64])
def test_order_of_rays(benchmark, camera, band_rows, capsys):
    rays = cast_rays(camera, 4_000_000, band_rows)
    scratch = Scratch(1, sweep_module.PASS_PLANES, camera.width_px, camera.height_px)
    rho = RHO[:: PLANES // sweep_module.PASS_PLANES]
    benchmark.pedantic(scratch.cast, (0, rays, rho), rounds=5, warmup_rounds=1)
    size = f"{camera.width_px}x{camera.height_px}, bands of {band_rows} rows"
    report(capsys, benchmark, f"sweep {size}, per event and plane", len(rays) * len(rho))


@pytest.mark.parametrize("planes", [2, 8])
def test_fold(benchmark, camera, planes, capsys):
    chosen = methods_by_name(PAPER, 2)
    pixels = camera.width_px * camera.height_px
    votes = np.random.default_rng(0).exponential(5, (2, planes, pixels)).astype(np.float32)
    maxima = RunningMaxima([method.fusion for method in chosen], camera.width_px, camera.height_px)
    benchmark.pedantic(lambda: maxima.update(votes, planes), rounds=9, warmup_rounds=1)
    units = planes * pixels * len(chosen)
    what = f"fold {camera.width_px}x{camera.height_px}, 8 methods, {planes} planes at once"
    report(capsys, benchmark, f"{what}, per voxel and method", units)
