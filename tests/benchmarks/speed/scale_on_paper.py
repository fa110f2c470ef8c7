"""What a large suite needs, on paper: measured costs of a small one, times how many there will be.

    python tests/benchmarks scale_on_paper [--sequences 1000 --methods 20 --seeds 10]
        [--empty 10000 --handed 500]

One case runs with one worker in a cache of its own. Its processor time, memory and bytes by stage
are those of a sequence, a window and a score; a window's time is taken to grow with its methods.
What is not a job's own is measured with empty ones: our list of them alone, and the same with
Dask's scheduler and two workers on this machine.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import eventsweep as es
from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval.jobs.dask import Cluster, DaskWorkers
from eventsweep.eval.jobs.job import Done, Job
from eventsweep.eval.jobs.scheduler import JobBoard, run_jobs
from eventsweep.eval.progress import SILENT
from eventsweep.eval.results.results import JobNote, Results
from eventsweep.eval.results.table import EVENTS
from kill_workers import Victims

_SUITE, _CASE = "quick", "planes"
_NOTHING = "", "", 0.0, False, ""


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


class Overhead(NamedTuple):
    """What an empty job takes: µs of our list of jobs; with Dask, ms of processors, and jobs/s."""

    board_us: float
    client_ms: float
    scheduler_ms: float
    jobs_per_s: float


class Empty(DaskWorkers):
    """A cluster's workers, which are given nothing to do."""

    def start(self, job: Job) -> Any:
        """Hands over nothing under a job's name."""
        return self._client.submit(Done, job.name, *_NOTHING, key=job.name, pure=False)


def cpu_s(process: int) -> float:
    """Time of processors that a process took, s."""
    words = Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def board_us(jobs: list[Job]) -> float:
    """What our list of jobs takes for each, µs."""
    started_s = time.process_time()
    board = JobBoard(jobs)
    for job in board.start():
        board.take(Done(job.name, *_NOTHING))
        board.words(1)
    return (time.process_time() - started_s) / len(jobs) * 1e6


def overhead(empty: int, count: int, folder: Path) -> Overhead:
    """What empty jobs take; `count` are handed to Dask, which a busy machine does 50 a second."""
    jobs = [Job(str(k), "none", {}) for k in range(count)]
    cluster = Victims(workers=2)
    try:
        crew = Empty(Cluster(cluster.address), folder)
        scheduler, client = cluster.scheduler, os.getpid()
        while crew.count < 2:
            time.sleep(0.1)
        before_s = cpu_s(client), cpu_s(scheduler), time.monotonic()
        outcomes = run_jobs(jobs, lambda: nullcontext(crew), SILENT)
        after_s = cpu_s(client), cpu_s(scheduler), time.monotonic()
        crew.leave()
        assert all(isinstance(one, Done) for one in outcomes.values())
    finally:
        cluster.end()
    ours_s, theirs_s, wall_s = (
        after - before for before, after in zip(before_s, after_s, strict=True)
    )
    alone = [Job(str(k), "none", {}) for k in range(empty)]
    return Overhead(board_us(alone), ours_s / count * 1e3, theirs_s / count * 1e3, count / wall_s)


def table(
    measured: Results, cache: Path, empty: Overhead, sequences: int, methods: int, seeds: int
) -> str:
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
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    slowest_ms = max(empty.client_ms, empty.scheduler_ms)
    busy = cpu_h * 3600 / jobs / (slowest_ms * 1e-3)
    lines += [
        "",
        f"Sum: {jobs:,} jobs, {cpu_h:,.0f} CPU hours, {stored / 1e12:.2f} TB stored; the largest "
        f"worker took {peak:.1f} GB. An empty job takes our list of jobs {empty.board_us:.0f} µs, "
        f"the program that hands it to Dask {empty.client_ms:.2f} ms, and Dask's scheduler "
        f"{empty.scheduler_ms:.2f} ms of a processor: {empty.jobs_per_s:.0f} jobs a second here. "
        f"The slower of the two keeps {busy:,.0f} workers busy.",
    ]
    return "\n".join(lines)


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    numbers = (
        ("sequences", 1000),
        ("methods", 20),
        ("seeds", 10),
        ("empty", 10_000),
        ("handed", 500),
    )
    for name, default in numbers:
        parser.add_argument(f"--{name}", type=int, default=default)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        out, cache = Path(folder) / "out", Path(folder) / "cache"
        measured = es.run_suite(_SUITE, out, cases=[_CASE], seeds=[0], workers=1, cache=cache)
        empty = overhead(asked.empty, asked.handed, cache)
        text = table(measured, cache, empty, asked.sequences, asked.methods, asked.seeds)
    sys.stdout.write(f"{text}\n")


if __name__ == "__main__":
    main()
