"""Time and memory of a large score, by step: `python tests/benchmarks bench_geometry`.

Writes a cloud of `--points` points and as many true discs, then reads and scores them in a process
of its own, as `score` does: with every metric of every class, without a page. `--page` writes the
table into a page.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.plugins.geometry import nearest, score, surfels, truth
from eventsweep.plugins.geometry.config import GeometryConfig
from eventsweep.plugins.geometry.ply import write_points
from eventsweep.plugins.geometry.readers import read_geometry
from eventsweep.plugins.geometry.surfels import KINDS, Surfels
from markdown_blocks import show
from simulate_stages import machine
from table_code import FOREIGN, ROOT, Code

MARK = "large"
POINTS, WALLS, SPACING_M = 10_000_000, 10, 0.01
_CLOUD, _TRUTH = "cloud.ply", "truth"
_NOISE_M, _STRAY_M, _STRAY_SHARE = 0.01, 0.5, 0.05
_STEPS = (
    (surfels, "along_curve", "order along the curve"),
    (score, "along_curve", "order along the curve"),
    (nearest.Nearest, "__init__", "boxes"),
    (nearest.Nearest, "query", "nearest, both ways"),
    (score.Judge, "_check_place", "place and unit"),
)


class Step(NamedTuple):
    """What a step took; its memory is the most of the whole process while it ran."""

    name: str
    wall_s: float
    cpu_s: float
    peak_mb: float


def made(points: int, folder: Path) -> None:
    """Writes walls of discs, as a cache holds them, and a noisy cloud of the same walls."""
    rng, side = np.random.default_rng(0), int((points / WALLS) ** 0.5)
    count = side * side * WALLS
    wall, cell = np.divmod(np.arange(count), side * side)
    axis = (wall + np.arange(3)[:, None]) % 3

    def placed(along: Any, across: Any, off: Any) -> Any:
        places = np.empty((count, 3))
        for k, values in zip(axis, (off, along, across), strict=True):
            np.put_along_axis(places, k[:, None], values[:, None], axis=1)
        return places

    u, v = np.divmod(cell, side) + rng.random((2, count))
    centres = placed(u * SPACING_M, v * SPACING_M, wall * 1.0)
    normals = placed(np.zeros(count), np.zeros(count), np.ones(count)).astype(np.float32)
    radius, depth = (np.full(count, size, np.float32) for size in (SPACING_M / 2**0.5, 3.0))
    kind, views = rng.integers(0, len(KINDS), count), rng.integers(1, 20, count)
    discs = Surfels(centres, normals, radius, depth, kind.astype(np.uint8), views.astype(np.int32))
    (folder / _TRUTH).mkdir()
    truth.store(folder / _TRUTH, surfels.ordered(discs))
    spread = np.where(rng.random(count) < _STRAY_SHARE, _STRAY_M, _NOISE_M)
    u, v = rng.random((2, count)) * side * SPACING_M
    cloud = placed(u, v, wall + rng.normal(size=count) * spread).astype(np.float32)
    write_points(folder / _CLOUD, dict(zip("xyz", cloud.T, strict=True)))


class _Clock:
    """Adds up what steps take; the kernel's mark of the most memory is set back before each."""

    def __init__(self) -> None:
        self.steps: dict[str, Step] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        Path("/proc/self/clear_refs").write_text("5")
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        yield
        took = time.perf_counter() - wall_s, time.process_time() - cpu_s
        before = self.steps.get(name, Step(name, 0, 0, 0))
        self.steps[name] = Step(
            name, before.wall_s + took[0], before.cpu_s + took[1], max(before.peak_mb, _peak_mb())
        )

    def around(self, owner: object, name: str, called: str) -> None:
        """Makes a function a step of its own, inside whatever calls it."""
        function: Callable[..., Any] = getattr(owner, name)

        def timed(*arguments: Any, **named: Any) -> Any:
            with self.step(called):
                return function(*arguments, **named)

        setattr(owner, name, timed)


def _peak_mb() -> float:
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM:")).split()[1]) / 1024


def measured(folder: Path) -> list[Step]:
    """Reads and scores what `made` wrote, in this process; the last step is the whole.

    Compiled kernels are loaded before by a small score.
    """
    rng = np.random.default_rng(0)
    small = Surfels(
        rng.random((500, 3)), np.tile(np.float32((0, 0, 1)), (500, 1)),
        *np.full((2, 500), 0.1, np.float32), np.zeros(500, np.uint8), np.ones(500, np.int32),
    )  # fmt: skip
    judge = score.Judge(small)
    list(judge.scores(judge.score(rng.random((500, 3)))))
    clock = _Clock()
    for owner, name, called in _STEPS:
        clock.around(owner, name, called)
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    with clock.step("read the cloud"):
        points = read_geometry(str(folder / _CLOUD), GeometryConfig()).points
    with clock.step("read the truth"):
        discs = truth.stored(folder / _TRUTH)
    judge = score.Judge(discs)
    found = judge.score(points)
    with clock.step("metrics of every class"):
        count = sum(1 for _ in judge.scores(found))
    took = time.perf_counter() - wall_s, time.process_time() - cpu_s
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    peak_mb = max(peak_mb, *(step.peak_mb for step in clock.steps.values()))
    sys.stderr.write(f"{count} metrics\n")
    return [*clock.steps.values(), Step("all", *took, peak_mb)]


def table(points: int, steps: list[Step]) -> str:
    """A line per step in Markdown."""
    lines = [
        f"Written by `python tests/benchmarks bench_geometry`: {points / 1e6:g} million points "
        f"against as many true discs, on {machine()}",
        "",
        "| Step | wall, s | CPU, s | peak memory, MB |",
        "|---|--:|--:|--:|",
    ]
    lines += [f"| {s.name} | {s.wall_s:.1f} | {s.cpu_s:.1f} | {s.peak_mb:,.0f} |" for s in steps]
    return "\n".join(lines) + "\n"


def in_its_own_process(folder: Path) -> list[Step]:
    """`measured` in a fresh process.

    Raises:
        InputError: it failed.
    """
    tool = [sys.executable, str(ROOT / "tests/benchmarks"), "bench_geometry"]
    command = [*tool, "--measure", str(folder)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise InputError(f"scoring ended with exit code {done.returncode}; see above")
    return [Step(*one) for one in json.loads(done.stdout)]


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    functions = ("bench_geometry:made", "bench_geometry:measured", "bench_geometry:table")
    without = (*FOREIGN, "eventsweep.emvs.dsi")  # of clouds alone; nothing is mapped
    return {f"plugins/geometry/geometry.md#{MARK}": Code(functions, without=without)}


def main() -> int:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=POINTS)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.measure:
        sys.stdout.write(json.dumps(measured(asked.measure)))
        return 0
    with exit_code() as ended, TemporaryDirectory() as folder:
        made(asked.points, Path(folder))
        steps = in_its_own_process(Path(folder))
        show(table(asked.points, steps), asked.page, MARK, code)
    return ended.value


if __name__ == "__main__":
    sys.exit(main())
