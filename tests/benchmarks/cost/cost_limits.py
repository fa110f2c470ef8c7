"""What the mapper costs, held against the limits that it is built for."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numba
import numpy as np

from cost_stream import DEPTH_RANGE_M, WINDOW_US, MovingEdges
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.dsi.fusion import MEANS
from eventsweep.emvs.dsi.maxima import RunningMaxima
from eventsweep.emvs.dsi.rays import Rays, event_rays, grouped_by_rows
from eventsweep.emvs.dsi.voting import Scratch, batch_planes
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.methods import methods_by_name, with_volume
from eventsweep.emvs.reference_view import inverse_depth_planes
from eventsweep.emvs.utils.runtime import use_threads
from peak_memory import peak_mb

SENSORS = {"346x260": (346, 260), "640x480": (640, 480), "1280x720": (1280, 720)}
VOTE_LIMIT_NS = {"346x260": 2.6, "640x480": 3.0, "1280x720": 3.6}
_LARGE = "1280x720"
PAPER = (*(f"Alg1/{name}" for name in MEANS), "EMVS/cam0", "EMVS/cam1")
_PLANES_TIMED = 24


@dataclass(frozen=True)
class Figure:
    """One measured cost.

    Attributes:
        what: what was measured.
        value: the number.
        unit: its unit.
        limit: what it must not exceed, or reach; None where there is no limit.
        better: which side of the limit is wanted.
    """

    what: str
    value: float
    unit: str
    limit: float | None = None
    better: Literal["lower", "higher"] = "lower"

    @property
    def is_held(self) -> bool | None:
        """Whether the limit is kept, None without one."""
        if self.limit is None:
            return None
        return self.value <= self.limit if self.better == "lower" else self.value >= self.limit


@dataclass(frozen=True)
class LimitsEffort:
    """How much is measured; less for a trial run.

    Attributes:
        vote_events: events for the time of a vote.
        whole_events: events per camera for the whole algorithm.
        planes: planes of the whole algorithm.
        rounds: of each measurement the best of so many counts.
        whole_rounds: the same for the whole algorithm.
        touchy_rounds: the same for two threads, which both wait when one of two cores is taken for
            a moment, and for the fold, which waits for memory that others use.
    """

    vote_events: int = 2_000_000
    whole_events: int = 4_000_000
    planes: int = 100
    rounds: int = 7
    whole_rounds: int = 6
    touchy_rounds: int = 40


def limits(effort: LimitsEffort) -> list[Figure]:
    """Measures every figure that has a limit, and its neighbours."""
    figures = []
    for sensor in SENSORS:
        figures += _votes(sensor, effort)
    figures += [*_threads(effort), _fusion(effort), *_whole(effort), _memory(effort), _start()]
    use_threads(0)
    return figures


def sideways_rays(recording: MovingEdges, camera: int) -> Rays:
    """Rays of one camera of a recording, as the mapper casts them into camera 0's view."""
    rig, motion = recording.rig, recording.trajectory
    T_world_rv = motion.at(WINDOW_US // 2)
    events = recording.events(camera, 0, WINDOW_US)
    rays = event_rays(
        events, rig.cameras[camera], rig.T_body_cam[camera], motion, T_world_rv, rig.cameras[0]
    )
    rho = inverse_depth_planes(*DEPTH_RANGE_M, _PLANES_TIMED)
    return grouped_by_rows(rays, float(rho[_PLANES_TIMED // 2]), rig.cameras[0].height_px)


def _votes(sensor: str, effort: LimitsEffort) -> list[Figure]:
    """Votes on one thread: both variants."""
    size = SENSORS[sensor]
    rays = sideways_rays(MovingEdges(size, effort.vote_events, cameras=1), 0)
    votes = len(rays) * _PLANES_TIMED
    runs = {
        "bilinear": partial(_cast, rays, size, 1),
        "nearest": partial(_cast, rays, size, 1, nearest=True),
    }
    cpu_s = _best(runs, effort.rounds, time.process_time)
    return [
        Figure(f"bilinear vote, {sensor}", 1e9 * cpu_s["bilinear"] / votes, "ns",
               VOTE_LIMIT_NS[sensor]),
        Figure(f"nearest vote, {sensor}", 1e9 * cpu_s["nearest"] / votes, "ns"),
    ]  # fmt: skip


def _threads(effort: LimitsEffort) -> list[Figure]:
    """What a second thread gives; sensors take turns, so that a disturbance meets all."""
    if numba.config.NUMBA_NUM_THREADS < 2:  # type: ignore[attr-defined]
        return []
    runs: dict[str, Callable[[], object]] = {}
    for sensor, size in SENSORS.items():
        rays = sideways_rays(MovingEdges(size, effort.vote_events, cameras=1), 0)
        runs |= {f"{sensor} {n}": partial(_cast, rays, size, n) for n in (1, 2)}
    wall_s = _best(runs, effort.touchy_rounds, time.perf_counter)
    return [
        Figure(f"two threads against one, {sensor}", wall_s[f"{sensor} 1"] / wall_s[f"{sensor} 2"],
               "×", 1.8, "higher")
        for sensor in SENSORS
    ]  # fmt: skip


def batches(planes: int, threads: int, plane_px: int, volumes: int = 1) -> list[tuple[int, int]]:
    """First and last planes of each batch, as large as `batch_planes` says."""
    step = batch_planes(planes, threads, plane_px, volumes)
    return [(first, min(first + step, planes)) for first in range(0, planes, step)]


def _cast(rays: Rays, size: tuple[int, int], threads: int, *, nearest: bool = False) -> None:
    use_threads(threads)
    load = (_PLANES_TIMED, threads, size[0] * size[1])
    scratch = Scratch(1, batch_planes(*load), *size, nearest=nearest)
    rho = inverse_depth_planes(*DEPTH_RANGE_M, _PLANES_TIMED)
    for first, last in batches(*load):
        scratch.cast(0, rays, rho[first:last])


def _fusion(effort: LimitsEffort) -> Figure:
    """Fusion by H and its running maximum, inside the sweep that casts the votes; one thread."""
    use_threads(1)
    width, height = SENSORS[_LARGE]
    recording = MovingEdges((width, height), effort.whole_events // 8)
    rays = [sideways_rays(recording, k) for k in (0, 1)]
    rho = inverse_depth_planes(*DEPTH_RANGE_M, effort.planes)
    load = (effort.planes, 1, width * height, 2)
    scratch = Scratch(2, batch_planes(*load), width, height)
    best_s, fusion = np.inf, with_volume(methods_by_name(("Alg1/H",), 2))[0].fusion
    for _ in range(effort.touchy_rounds):
        maxima, spent_s = RunningMaxima((fusion,), width, height), 0.0
        for first, last in batches(*load):
            for k in (0, 1):
                scratch.cast(k, rays[k], rho[first:last])
            begin = time.process_time()
            maxima.update(scratch.votes, last - first)
            spent_s += time.process_time() - begin
        best_s = min(best_s, spent_s)
    what = f"fusion by H and argmax, {_LARGE}, {effort.planes} planes, one thread"
    return Figure(what, 1e3 * best_s, "ms", 60)


def _whole(effort: LimitsEffort) -> list[Figure]:
    """Algorithm 1 from events to depth maps: one function against six and both cameras."""
    recording = MovingEdges(SENSORS[_LARGE], effort.whole_events)
    recording.event_span_us(0)  # makes the events now
    asked = {"one": ("Alg1/H",), "eight": PAPER, "all": ("all",)}
    configs = {
        name: MapperConfig(planes=effort.planes, methods=names, threads=1)
        for name, names in asked.items()
    }
    runs = {name: partial(map_window, recording, config) for name, config in configs.items()}
    cpu_s = _best(runs, effort.whole_rounds, time.process_time)
    what = f"Alg. 1, 2 × {effort.whole_events / 1e6:g} M events, {_LARGE}, {effort.planes} planes"
    eight, with_focus = (cpu_s[name] / cpu_s["one"] for name in ("eight", "all"))
    return [
        Figure(f"{what}, one thread: H alone", cpu_s["one"], "s"),
        Figure("six functions and both cameras, against H alone", eight, "×", 1.3),
        Figure("`all`, which has `Focus/H` too, against H alone", with_focus, "×"),
    ]


_MAP = """
import sys
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.mapper import map_window
map_window(open_recording(sys.argv[1]), MapperConfig(planes={planes}, methods={methods}))
"""

_FIRST_EVENT = """
import os, sys
from eventsweep.eval.cli.main import main
from eventsweep.emvs.data.sequence import Sequence
def first(*_):
    print("first", flush=True)
    os._exit(0)
Sequence.events = first
main(["map", sys.argv[1], "--out", sys.argv[1] + "-map", "--quiet"])
"""


def peak_of_map(
    methods: Sequence[str], size_px: tuple[int, int], events: int, planes: int
) -> float:
    """Peak memory of a process that maps a recording of two cameras from disk, MB.

    Args:
        methods: what it maps.
        size_px: columns and rows of the cameras.
        events: of each camera.
        planes: depth planes.
    """
    program = _MAP.format(planes=planes, methods=tuple(methods))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "edges"
        MovingEdges(size_px, events).write(path)
        return peak_mb(program, [str(path)])


def _memory(effort: LimitsEffort) -> Figure:
    """Peak memory of a process that maps a recording from disk."""
    what = "peak memory of that run of eight, read from disk"
    found = peak_of_map(PAPER, SENSORS[_LARGE], effort.whole_events, effort.planes)
    return Figure(what, found, "MB", 700)


def _start() -> Figure:
    """From the start of the process to the first event that `eventsweep map` reads."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "edges"
        MovingEdges(SENSORS["346x260"], 100_000).write(path)
        best_s = np.inf
        for _ in range(3):
            begin = time.perf_counter()
            subprocess.run([sys.executable, "-c", _FIRST_EVENT, str(path)], check=True,
                           capture_output=True)  # fmt: skip
            best_s = min(best_s, time.perf_counter() - begin)
    return Figure("`eventsweep map`, from its start to its first event", float(best_s), "s", 2)


def _best(
    runs: Mapping[str, Callable[[], object]], rounds: int, clock: Callable[[], float]
) -> dict[str, float]:
    """The best time of each run, s; they take turns, so that a disturbance meets all of them."""
    best = dict.fromkeys(runs, float("inf"))
    for run in runs.values():
        run()
    for _ in range(rounds):
        for name, run in runs.items():
            begin = clock()
            run()
            best[name] = min(best[name], clock() - begin)
    return best
