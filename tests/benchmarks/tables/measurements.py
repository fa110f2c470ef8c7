"""Measures the tables anew that are older than their code: `python tests/benchmarks measurements`.

A part whose tables are of today's code is skipped, so the same command goes on after an
interruption; what an unfinished part had done is in its folder below `out`, which belongs to one
state of the code, or in the cache of jobs. `--plan` prints what would run. What times programs
runs alone, first; `--at-once N` runs N of the others side by side.

Not among them are what needs a decision, a recording or a GPU: `eventsweep gate --update`, the
ranking's data, `make pictures SLIDER=FOLDER`, `track_slider`, `bench_gpu`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from stale_tables import digest_of, stale
from table_code import ROOT

_TOOL = "python tests/benchmarks"
_FIDELITY = f"{_TOOL} fidelity --truth OUT --page docs/simulator.md"
_LEARNED, _PAGE = f"{_TOOL} calibrate_confidence", "--page plugins/learned/learned.md"
_WITH_ERRORS = "Focus/H Learned/H Focus/cam0 Learned/cam0"
_HELD_OUT = "boxes-2 planes-2 rpg-reader rpg-bin tumvie-1d"


@dataclass(frozen=True)
class Part:
    """A command that writes tables; `OUT` in it is a folder for this state of their code.

    Attributes:
        tables: `PAGE#MARK` of each.
        command: a line of the shell.
        cpu_min: processor time when it was last noted, min; None where it never was.
        timed: whether it times programs, and so wants the machine for itself.
    """

    tables: tuple[str, ...]
    command: str
    cpu_min: float | None = None
    timed: bool = False

    @property
    def line(self) -> str:
        """The command with its folder."""
        state = digest_of(self.tables[0])
        return self.command.replace("OUT", f"out/measured/{self.tables[0].split('#')[1]}-{state}")


PARTS = (
    Part(("docs/scenes.md#figures",), f"{_TOOL} scene_tables docs/scenes.md"),
    Part(("docs/install.md#sizes",), f"{_TOOL} install_page --page docs/install.md"),
    Part(
        ("docs/formats.md#speeds",),
        "EVENT_FORMATS_PAGE=docs/formats.md python -m pytest -p no:xdist --benchmark-only "
        "tests/benchmarks/speed/bench_formats.py",
        timed=True,
    ),
    Part(
        ("docs/simulator.md#simulate-stages",),
        f"{_TOOL} simulate_stages --page docs/simulator.md",
        timed=True,
    ),
    Part(("docs/gate.md#first-runs",), f"{_TOOL} first_runs --page docs/gate.md", timed=True),
    Part(("docs/suite.md#scale",), f"{_TOOL} scale_on_paper --page docs/suite.md", 0.7),
    Part(("docs/gate.md#recipe",), f"{_TOOL} recipe_runs --work OUT --page docs/gate.md"),
    Part(
        ("plugins/raster/raster.md#raster",),
        f"{_TOOL} bench_raster --page plugins/raster/raster.md",
        timed=True,
    ),
    Part(
        ("plugins/geometry/geometry.md#large",),
        f"{_TOOL} bench_geometry --page plugins/geometry/geometry.md",
        1.7,
    ),
    Part(
        ("plugins/geometry/geometry.md#geometry-scores",),
        f"{_TOOL} geometry_scores --out OUT --page plugins/geometry/geometry.md",
    ),
    Part(
        ("plugins/align/align.md#align-draws",),
        f"{_TOOL} align_draws --out OUT --page plugins/align/align.md",
    ),
    Part(("docs/simulator.md#fidelity-rays",), f"{_FIDELITY} --rays"),
    Part(("docs/simulator.md#fidelity-drawn",), f"{_FIDELITY} --drawn 2028"),
    Part(("docs/studies.md#studies",), "make studies", 19.4),
    Part(("docs/paper.md#paper",), "make paper"),
    Part(
        ("docs/paper.md#reproduction",),
        f"{_TOOL} reproduction --out OUT --page docs/paper.md",
    ),
    Part(("docs/baselines.md#baselines",), "make pictures-baselines"),
    Part(
        ("plugins/diagnose/check.md#check-faults",),
        f"{_TOOL} check_faults --out OUT --page plugins/diagnose/check.md",
    ),
    Part(
        ("plugins/track/odometry.md#track-scores",),
        f"{_TOOL} track_scores --out OUT --seeds 521-523 --page plugins/track/odometry.md",
    ),
    Part(
        ("plugins/track/odometry.md#track-latency",),
        f"{_TOOL} track_latency --out OUT --page plugins/track/odometry.md",
        timed=True,
    ),
    Part(
        ("plugins/learned/learned.md#confidence",),
        f"{_LEARNED} --cache OUT {_PAGE} --cases {_HELD_OUT} --methods {_WITH_ERRORS}",
    ),
    Part(
        ("plugins/learned/learned.md#left-out",),
        f"{_LEARNED} --left-out --sequences OUT {_PAGE} --methods {_WITH_ERRORS}",
    ),
    Part(("docs/simulator.md#fidelity",), f"{_FIDELITY} --picture docs/images/fidelity.png"),
)
"""In this order: cheap ones first."""


def due() -> Iterator[Part]:
    """The parts with a stale table."""
    old = stale()
    yield from (part for part in PARTS if not old.keys().isdisjoint(part.tables))


def run(part: Part) -> float:
    """Runs a part's command in the checkout; returns the processor time that it took, min.

    Raises:
        InputError: it failed.
    """
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    started = subprocess.Popen(part.line, shell=True, cwd=ROOT, env=os.environ | {"PATH": programs})
    _, status, used = os.wait4(started.pid, 0)  # of this command alone, whatever else runs
    started.returncode = os.waitstatus_to_exitcode(status)
    if started.returncode:
        raise InputError(
            f"exit code {started.returncode} of `{part.line}`; the same command goes on from here"
        )
    return (used.ru_utime + used.ru_stime) / 60


def run_and_print(part: Part) -> None:
    """Runs a part, and says what it was and what it took."""
    taken_min = run(part)
    sys.stdout.write(f"{', '.join(part.tables)}: took {taken_min:.1f} CPU min\n")
    sys.stdout.flush()


def plan_of(part: Part) -> str:
    """What would run, and what it is known to cost."""
    known = "not known" if part.cpu_min is None else f"{part.cpu_min:g}"
    return f"{', '.join(part.tables)}: CPU min {known}: {part.line}"


def side_by_side(parts: Sequence[Part], at_once: int) -> None:
    """Runs some parts at a time; after a failure none begins.

    Raises:
        InputError: one failed.
    """
    failed = Event()

    def unless_failed(part: Part) -> None:
        if not failed.is_set():
            try:
                run_and_print(part)
            except BaseException:
                failed.set()
                raise

    with ThreadPoolExecutor(at_once) as pool:
        for done in [pool.submit(unless_failed, part) for part in parts]:
            done.result()


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures, or plans; 2 where a command fails."""
    parser = argparse.ArgumentParser(prog=f"{_TOOL} measurements", description=__doc__)
    parser.add_argument("--plan", action="store_true", help="print what would run, and run nothing")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="parts side by side")
    asked = parser.parse_args(arguments)
    with exit_code() as ended:
        parts = sorted(due(), key=lambda part: not part.timed)
        if asked.plan:
            sys.stdout.writelines(f"{plan_of(part)}\n" for part in parts)
            return ended.value
        for part in (part for part in parts if part.timed):
            run_and_print(part)
        side_by_side([part for part in parts if not part.timed], asked.at_once)
    return ended.value


if __name__ == "__main__":
    sys.exit(main())
