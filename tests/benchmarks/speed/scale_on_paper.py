"""What a large suite needs, on paper: measured costs of a small one, times how many there will be.

    python tests/benchmarks scale_on_paper [--sequences 1000 --methods 20 --seeds 10]
        [--empty 100000 --workers 4] [--page docs/suite.md]

One case runs with one worker in a cache of its own, with two seeds of which the second counts: the
first loads and compiles. Its processor time, memory and bytes by stage are those of a sequence, a
window and a score; time and bytes of maps and scores are taken to grow with the methods. What is
not a job's own is measured with empty ones: our list of them alone, and the same with Dask's
scheduler and workers on this machine. All times are of processors: other work on the machine
changes them little.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

import eventsweep as es
from eventsweep.emvs.utils.cache import Cache
from eventsweep.emvs.utils.files import bytes_text
from eventsweep.eval.jobs.batches import do_batch, packed, unpacked
from eventsweep.eval.jobs.dask import Cluster, DaskWorkers
from eventsweep.eval.jobs.job import Done, Job, code_of, order
from eventsweep.eval.jobs.scheduler import JobBoard, run_jobs
from eventsweep.eval.progress import SILENT
from eventsweep.eval.results.results import JobNote, Results
from eventsweep.eval.results.table import EVENTS
from eventsweep.eval.suite.definition import load
from eventsweep.eval.suite.plan import suite_jobs
from kill_workers import Victims
from markdown_blocks import show
from simulate_stages import machine
from table_code import Code

_SUITE, _CASE, _SEED = "quick", "planes", 1  # seed 0 loads and compiles
_NOTHING = "", "", 0.0, False, ""
_WARM, _SINGLE = 1000, 500  # empty jobs before any is counted, and those handed over alone


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


def nothing(parcel: bytes) -> bytes:
    """`do_batch` of jobs in which there is nothing to do."""
    return packed(([Done(job.name, *_NOTHING) for job, _, _ in unpacked(parcel)], 0.0))


class Empty(DaskWorkers):
    """A cluster's workers, which do nothing of what they are handed."""

    do = staticmethod(nothing)


class OneByOne(Empty):
    """The same, a job at a time."""

    def submit(self, job: Job) -> None:
        """Takes a job that is a batch."""
        self._batches.again([(job,)])


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


def handed_ms(crew_of: type[Empty], count: int, workers: int, folder: Path) -> tuple[float, float]:
    """What an empty job takes this program, and Dask's scheduler, ms of processors."""
    cluster = Victims(workers)
    try:
        crew = crew_of(Cluster(cluster.address), folder)
        while crew.count < workers:
            time.sleep(0.1)
        both = os.getpid(), cluster.scheduler
        run_jobs(empty_jobs(_WARM), lambda: nullcontext(crew), SILENT)
        before_s = [cpu_s(process) for process in both]
        outcomes = run_jobs(empty_jobs(count), lambda: nullcontext(crew), SILENT)
        ours_s, theirs_s = (
            cpu_s(process) - before for process, before in zip(both, before_s, strict=True)
        )
        crew.leave()
    finally:
        cluster.end()
    assert len(outcomes) == count
    assert all(isinstance(one, Done) for one in outcomes.values())
    return ours_s / count * 1e3, theirs_s / count * 1e3


def empty_jobs(count: int) -> list[Job]:
    """Jobs of a stage that exists, and that nobody runs."""
    return [Job(f"empty/{k}", "job_stages", {"id": k}) for k in range(count)]


def empty_table(count: int, workers: int, folder: Path) -> tuple[str, float]:
    """What empty jobs take, as Markdown; and how many a second the slowest program can pass on."""
    lines = [
        "| Empty jobs | our list, ms | program, ms | Dask's scheduler, ms | jobs/s |",
        "|---|--:|--:|--:|--:|",
    ]
    board_ms = board_us(empty_jobs(count)) * 1e-3
    for name, crew_of, number in (
        (f"{_SINGLE:,}, each handed over alone", OneByOne, _SINGLE),
        (f"{count:,}, in batches", Empty, count),
    ):
        ours_ms, theirs_ms = handed_ms(crew_of, number, workers, folder)
        per_s = 1e3 / max(ours_ms, theirs_ms)
        lines.append(
            f"| {name} | {board_ms:.3f} | {ours_ms:.3f} | {theirs_ms:.3f} | {per_s:,.0f} |"
        )
    return "\n".join(lines), per_s


class Many(NamedTuple):
    """How much is planned."""

    sequences: int
    methods: int
    seeds: int


def carried(cache: Path) -> dict[str, int]:
    """By stage, bytes that a scheduler carries of its jobs and of what came of them."""
    found: Counter[str] = Counter()
    for job in order(suite_jobs(load(_SUITE)[0], [_CASE], [_SEED])):
        parcel = packed([(job, str(cache), code_of(job))])
        outcomes = do_batch(parcel)
        assert all(one.found for one in unpacked(outcomes)[0])
        found[job.name.partition("/")[0]] += len(parcel) + len(outcomes)
    return found


def table(measured: Results, cache: Path, many: Many) -> tuple[str, float]:
    """What that many sequences need, as Markdown; and what a job takes, s of a processor."""
    here, times = len({*measured.rows["method"]} - {EVENTS}), many.sequences * many.seeds
    lines = [
        "| Stage | jobs | CPU h | stored | read | through the scheduler |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    notes = [note for note in measured.jobs if f"seed{_SEED}" in note.name.split("/")]
    stages, sent = costs(notes, cache), carried(cache)
    sums = [0.0] * 5
    for stage, cost in stages.items():
        grown = times * (1.0 if stage == "simulate" else many.methods / here)
        reads = {
            "map": times * cost.jobs * stages["simulate"].bytes,
            "score": times * stages["simulate"].bytes + grown * stages["map"].bytes,
        }
        row = (
            cost.jobs * times, cost.cpu_s * grown / 3600, cost.bytes * grown,
            reads.get(stage, 0.0), sent[stage] * times,
        )  # fmt: skip
        sums = [a + b for a, b in zip(sums, row, strict=True)]
        lines.append(_line(stage, row))
    lines.append(_line("**together**", sums))
    return "\n".join(lines), sums[1] * 3600 / sums[0]


def _line(name: str, row: Sequence[float]) -> str:
    jobs, cpu_h, *sizes = row
    told = " | ".join(bytes_text(round(size)) if size else "–" for size in sizes)
    return f"| {name} | {jobs:,.0f} | {cpu_h:,.0f} | {told} |"


def block(many: Many, empty: int, workers: int, folder: Path) -> str:
    """Measures; returns both tables with what follows from them."""
    cache, about = folder / "cache", machine()
    measured = es.run_suite(
        _SUITE, folder / "out", cases=[_CASE], seeds=[0, _SEED], workers=1, cache=cache
    )
    peak_gb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024e-9
    needs, job_s = table(measured, cache, many)
    overhead, per_s = empty_table(empty, workers, cache)
    return (
        f"{about}\n\n"
        f"{many.sequences:,} sequences × {many.methods} methods × {many.seeds} seeds, each as "
        f"`{_CASE}` of `{_SUITE}` (0.2 s at 346×260, one window), need, and {peak_gb:.1f} GB of "
        f"memory per worker:\n\n{needs}\n\n{overhead}\n\nWith jobs of {job_s:.0f} s as above "
        f"the slower of these programs keeps {per_s * job_s:,.0f} workers busy.\n"
    )


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    batches = ("batches", "dask", "scheduler")
    own = Code(("scale_on_paper:block",), tuple(f"eventsweep.eval.jobs.{name}" for name in batches))
    return {"docs/suite.md#scale": own}


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    numbers = {"sequences": 1000, "methods": 20, "seeds": 10, "empty": 100_000, "workers": 4}
    for name, default in numbers.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    many = Many(asked.sequences, asked.methods, asked.seeds)
    with tempfile.TemporaryDirectory() as folder:
        text = block(many, asked.empty, asked.workers, Path(folder))
    show(text, asked.page, "scale", code)


if __name__ == "__main__":
    main()
