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
import json
import os
import resource
import tempfile
import time
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

from eventsweep.emvs.utils.cache import Cache
from eventsweep.emvs.utils.files import bytes_text
from eventsweep.eval.jobs.batches import BATCH_S, do_batch, packed, unpacked
from eventsweep.eval.jobs.dask import Cluster, DaskWorkers
from eventsweep.eval.jobs.job import Done, Job, code_of, order
from eventsweep.eval.jobs.local import local_workers
from eventsweep.eval.jobs.scheduler import JobBoard, run_jobs
from eventsweep.eval.progress import SILENT
from eventsweep.eval.results.table import EVENTS
from eventsweep.eval.suite.definition import load
from eventsweep.eval.suite.plan import suite_jobs
from kill_workers import Victims
from markdown_blocks import show
from simulate_stages import machine
from table_code import FOREIGN, Code, of_jobs

_SUITE, _CASE, _SEED = "quick", "planes", 1  # seed 0 loads and compiles
_NOTHING = "", "", 0.0, False, ""
_WARM, _SINGLE = 1000, 500  # empty jobs before any is counted, and those handed over alone
_PARCELS = 20


class Cost(NamedTuple):
    """What the jobs of a stage took: how many, processor s, and bytes in the cache, in all."""

    jobs: int
    cpu_s: float
    bytes: int


def measured(cache: Path) -> list[Done]:
    """What came of the case's jobs, done by one worker, of the seed that counts."""
    jobs = suite_jobs(load(_SUITE)[0], [_CASE], [0, _SEED])
    outcomes = run_jobs(jobs, lambda: local_workers(1, cache), SILENT)
    counted = [one for name, one in outcomes.items() if f"seed{_SEED}" in name.split("/")]
    done = [one for one in counted if isinstance(one, Done)]
    assert len(done) == len(counted), counted
    return done


def costs(outcomes: Iterable[Done], cache: Path) -> dict[str, Cost]:
    """Costs by stage, which a job's name begins with."""
    found: dict[str, Cost] = {}
    for one in outcomes:
        stage, made = one.name.partition("/")[0], Cache(cache).find(one.key)
        assert made is not None
        size = sum((made.path / name).stat().st_size for name in made.files)
        before = found.get(stage, Cost(0, 0.0, 0))
        found[stage] = Cost(before.jobs + 1, before.cpu_s + one.cpu_seconds, before.bytes + size)
    return found


def methods_of(outcomes: Iterable[Done]) -> int:
    """How many methods were scored."""
    scores = [json.loads(one.text)["rows"] for one in outcomes if one.text]
    return len({row["method"] for rows in scores for row in rows} - {EVENTS})


def nothing(parcel: bytes) -> bytes:
    """`do_batch` of jobs in which there is nothing to do."""
    return packed(([Done(job.name, *_NOTHING) for job, _, _ in unpacked(parcel)[1]], 0.0))


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


def alone(count: int) -> Overhead:
    """What so many empty jobs take each on our list of jobs, which nobody does."""
    jobs = empty_jobs(count)
    started_s = time.process_time()
    board = JobBoard(jobs)
    for job in board.start():
        board.take(Done(job.name, *_NOTHING))
        board.words(1)
    return Overhead((time.process_time() - started_s) / count * 1e3)


def empty_jobs(count: int) -> list[Job]:
    """Jobs of a stage that exists, and that nobody runs."""
    return [Job(f"empty/{k}", "job_stages", {"id": k}) for k in range(count)]


class Overhead(NamedTuple):
    """What an empty job takes, ms of a processor: of this program, and of Dask's scheduler."""

    program: float
    scheduler: float = 0.0

    @property
    def per_s(self) -> float:
        """Jobs a second of the slower of the two."""
        return 1e3 / max(self)


class Many(NamedTuple):
    """How much is planned."""

    sequences: int
    methods: int
    seeds: int


def overhead(crew_of: type[Empty], count: int, workers: int, folder: Path) -> Overhead:
    """What so many empty jobs take each, on Dask's workers."""
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
    return Overhead(ours_s / count * 1e3, theirs_s / count * 1e3)


class Handed(NamedTuple):
    """What handing over the jobs of a stage takes: ms of this program, and bytes both ways."""

    ms: float
    bytes: int


def handed(cache: Path) -> dict[str, Handed]:
    """What handing over takes beside that of an empty job, by stage."""
    found: dict[str, Handed] = {}
    for job in order(suite_jobs(load(_SUITE)[0], [_CASE], [_SEED])):
        parcel, started_s = _parcel(job, cache), time.process_time()
        for _ in range(_PARCELS):
            parcel = _parcel(job, cache)
        ms = (time.process_time() - started_s) / _PARCELS * 1e3
        outcomes = do_batch(parcel)
        assert all(one.found for one in unpacked(outcomes)[0])
        stage = job.name.partition("/")[0]
        before = found.get(stage, Handed(0.0, 0))
        found[stage] = Handed(before.ms + ms, before.bytes + len(parcel) + len(outcomes))
    return found


def _parcel(job: Job, cache: Path) -> bytes:
    return packed((BATCH_S, [(job, str(cache), code_of(job))]))


def needed(outcomes: Sequence[Done], cache: Path, many: Many) -> dict[str, tuple[float, ...]]:
    """By stage what that many sequences need.

    That is jobs, processors' h, bytes stored, read and passed on, and h of handing over.
    """
    here, times = methods_of(outcomes), many.sequences * many.seeds
    stages, over = costs(outcomes, cache), handed(cache)
    found: dict[str, tuple[float, ...]] = {}
    for stage, cost in stages.items():
        grown = times * (1.0 if stage == "simulate" else many.methods / here)
        reads = {
            "map": times * cost.jobs * stages["simulate"].bytes,
            "score": times * stages["simulate"].bytes + grown * stages["map"].bytes,
        }
        found[stage] = (
            cost.jobs * times, cost.cpu_s * grown / 3600, cost.bytes * grown,
            reads.get(stage, 0.0), over[stage].bytes * grown, over[stage].ms * times / 3.6e6,
        )  # fmt: skip
    return found


def line(name: str, row: Sequence[float]) -> str:
    """A line of the table of needs."""
    jobs, cpu_h, *sizes, _ = row
    told = " | ".join(bytes_text(round(size)) if size else "–" for size in sizes)
    return f"| {name} | {jobs:,.0f} | {cpu_h:,.0f} | {told} |"


def block(many: Many, count: int, workers: int, cache: Path) -> str:
    """Measures; returns both tables with what follows from them."""
    about, outcomes = machine(), measured(cache)
    peak_gb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024e-9
    needs = needed(outcomes, cache, many)
    sums = [sum(column) for column in zip(*needs.values(), strict=True)]
    rows = {
        f"{count:,}, without workers": alone(count),
        f"{_SINGLE:,}, one by one": overhead(OneByOne, _SINGLE, workers, cache),
        f"{count:,}, in batches": overhead(Empty, count, workers, cache),
    }
    job_s, more_ms = sums[1] / sums[0] * 3600, sums[-1] / sums[0] * 3.6e6
    single, batches = (
        job_s * Overhead(one.program + more_ms, one.scheduler).per_s
        for one in list(rows.values())[1:]
    )
    lines = [
        about, "",
        f"{many.sequences:,} sequences × {many.methods} methods × {many.seeds} seeds, each as "
        f"`{_CASE}` of `{_SUITE}` (0.2 s at 346×260, one window), with {peak_gb:.1f} GB of memory "
        "per worker:", "",
        "| Stage | Jobs | CPU h | Stored | Read | Through the scheduler |",
        "|---|--:|--:|--:|--:|--:|",
        *(line(stage, row) for stage, row in needs.items()), line("together", sums), "",
        f"| Empty jobs on {workers} workers, CPU ms | `eventsweep` | Dask's scheduler | Jobs/s |",
        "|---|--:|--:|--:|",
        *(f"| {name} | {one.program:.3f} | {one.scheduler:.3f} | {one.per_s:,.0f} |"
          for name, one in rows.items()), "",
        f"With jobs as above, of {job_s:.1f} s and {more_ms:.1f} ms more of `eventsweep`, that is "
        f"{single:,.0f} workers one by one, {batches:,.0f} in batches.",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    own = Code(("scale_on_paper:block",), without=FOREIGN)
    return {"docs/suite.md#scale": own + of_jobs(suite_jobs(load(_SUITE)[0], [_CASE], [_SEED]))}


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
