"""What a large suite needs, on paper: measured costs of a small one, times how many there will be.

    python tests/benchmarks scale_on_paper [--sequences 1000 --methods 20 --seeds 10]

One case runs with one worker in a cache of its own. Its processor time, memory and bytes by stage
are those of a sequence, a window and a score; a window's time is taken to grow with its methods.
The scheduler's share is measured with empty jobs on its own, without a network.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import eventsweep as es
from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval.jobs.job import Done, Job
from eventsweep.eval.jobs.scheduler import JobBoard
from eventsweep.eval.results.results import JobNote, Results
from eventsweep.eval.results.table import EVENTS

_EMPTY = 100_000
_SUITE, _CASE = "quick", "planes"


class Cost(NamedTuple):
    """What the jobs of a stage took: how many, processor s, and bytes in the cache, in all."""

    jobs: int
    cpu_s: float
    bytes: int


def costs(notes: Iterable[JobNote], cache: Path) -> dict[str, Cost]:
    """Costs by stage, which a job's name begins with."""
    found: dict[str, Cost] = {}
    for note in notes:
        stage, made = note.name.partition("/")[0], Cache(cache).find(note.key)
        assert made is not None
        size = sum((made.path / name).stat().st_size for name in made.files)
        before = found.get(stage, Cost(0, 0.0, 0))
        found[stage] = Cost(before.jobs + 1, before.cpu_s + note.cpu_seconds, before.bytes + size)
    return found


def microseconds_a_job() -> float:
    """What the scheduler takes for an empty job, µs."""
    jobs = [Job(str(k), "none", {}) for k in range(_EMPTY)]
    started_s = time.process_time()
    board = JobBoard(jobs)
    for job in board.start():
        board.take(Done(job.name, "", "", 0.0, found=False, code=""))
        board.words(1)
    return (time.process_time() - started_s) / _EMPTY * 1e6


def table(measured: Results, cache: Path, sequences: int, methods: int, seeds: int) -> str:
    """The table and its sums, as Markdown."""
    here = len({*measured.rows["method"]} - {EVENTS})
    lines = ["| stage | jobs | CPU h | stored | read by its jobs |", "|---|--:|--:|--:|--:|"]
    stages, many = costs(measured.jobs, cache), sequences * seeds
    jobs, cpu_h, stored = 0, 0.0, 0
    for stage, cost in stages.items():
        times = many * (methods / here if stage != "simulate" else 1.0)
        needs = stages["simulate"].bytes * cost.jobs if stage == "map" else 0
        needs = stages["simulate"].bytes + stages["map"].bytes if stage == "score" else needs
        hours, size = cost.cpu_s * times / 3600, round(cost.bytes * times)
        jobs, cpu_h, stored = jobs + cost.jobs * many, cpu_h + hours, stored + size
        lines.append(
            f"| {stage} | {cost.jobs * many:,} | {hours:,.0f} | {size / 1e12:.2f} TB | "
            f"{needs * many / 1e12:.2f} TB |"
        )
    each_us = microseconds_a_job()
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    busy = cpu_h * 3600 / jobs / (each_us * 1e-6)
    lines += [
        "",
        f"Sum: {jobs:,} jobs, {cpu_h:,.0f} CPU hours, {stored / 1e12:.2f} TB stored; the largest "
        f"worker took {peak:.1f} GB. The scheduler takes {each_us:.0f} µs a job, "
        f"{each_us * jobs * 1e-6:.0f} s in all: it keeps {busy:,.0f} workers busy.",
    ]
    return "\n".join(lines)


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, default in (("sequences", 1000), ("methods", 20), ("seeds", 10)):
        parser.add_argument(f"--{name}", type=int, default=default)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        out, cache = Path(folder) / "out", Path(folder) / "cache"
        measured = es.run_suite(_SUITE, out, cases=[_CASE], seeds=[0], workers=1, cache=cache)
        text = table(measured, cache, asked.sequences, asked.methods, asked.seeds)
    sys.stdout.write(f"{text}\n")


if __name__ == "__main__":
    main()
