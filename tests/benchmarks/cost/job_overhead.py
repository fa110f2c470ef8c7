"""What handing out jobs costs: jobs that only wait, on workers here and on a Dask cluster.

`python tests/benchmarks job_overhead --page docs/suite.md` runs as many jobs as keep every worker
busy for a while and compares the time of the clock with what the waiting alone takes. Whatever else
the machine does changes little.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.jobs.dask import Cluster, dask_workers
from eventsweep.eval.jobs.job import Done, Job
from eventsweep.eval.jobs.local import local_workers
from eventsweep.eval.jobs.scheduler import Workers, run_jobs
from eventsweep.eval.progress import Silent
from markdown_blocks import show

STAGE = "job_stages"
"""A stage of the tests; its folder is on the path of every worker."""

_START_S = 120
Open = Callable[[], AbstractContextManager[Workers]]


def took_s(workers: Open, log: Path, name: str, jobs: int, seconds: float) -> float:
    """Time of the clock for so many jobs that wait so long each, s."""
    facts = {"act": "sleep", "seconds": seconds, "log": str(log)}
    waiting = [Job(f"{name}{k}", STAGE, {"id": f"{name}{k}", **facts}) for k in range(jobs)]
    began_s = time.monotonic()
    outcomes = run_jobs(waiting, workers, Silent())
    elapsed_s = time.monotonic() - began_s
    failed = [one for one in outcomes.values() if not isinstance(one, Done)]
    if failed:
        raise InputError(f"{failed[0].name} failed: {failed[0].reason}")
    return elapsed_s


@contextmanager
def cluster(folder: Path, count: int) -> Iterator[Cluster]:
    """A Dask cluster of so many processes with one thread each, on this machine."""
    about = ["--no-dashboard", "--host", "127.0.0.1"]
    listening = folder / "scheduler.json"
    about += ["--scheduler-file", str(listening)]
    programs = [["scheduler", "--port", "0"], *[["worker", "--nthreads", "1"]] * count]
    with ExitStack() as ended:
        for what, *more in programs:
            command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *about, *more]
            process = ended.enter_context(subprocess.Popen(command, stderr=subprocess.DEVNULL))
            ended.callback(process.terminate)
        _wait_for(listening.exists)
        place = Cluster(json.loads(listening.read_text(encoding="utf-8"))["address"])
        with dask_workers(place, folder) as crew:
            _wait_for(lambda: crew.count >= count)
        yield place


def _wait_for(ready: Callable[[], bool]) -> None:
    until_s = time.monotonic() + _START_S
    while not ready():
        if time.monotonic() > until_s:
            raise InputError(f"no Dask cluster within {_START_S} s: is `distributed` installed?")
        time.sleep(0.1)


def main(arguments: list[str] | None = None) -> int:
    """Prints and writes the line; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--jobs", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=5, help="of one job")
    parser.add_argument("--page", type=Path, help="page to write the line into")
    asked = parser.parse_args(arguments)
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    ideal_s = asked.seconds * -(-asked.jobs // asked.workers)
    with exit_code() as code, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        work = partial(took_s, log=folder / "log", jobs=asked.jobs, seconds=asked.seconds)
        own_s = work(partial(local_workers, asked.workers, folder / "own"), name="own")
        with cluster(folder, asked.workers) as place:
            dask_s = work(partial(dask_workers, place, folder / "dask"), name="dask")
        text = (
            f"{asked.jobs} jobs that wait {asked.seconds:g} s each, {asked.workers} workers: "
            f"{100 * (own_s / ideal_s - 1):.1f} % more than the waiting on workers of one machine, "
            f"their start included, {100 * (dask_s / ideal_s - 1):.1f} % on a Dask cluster that is "
            "running.\n"
        )
        show(text, asked.page, "overhead")
    return code.value


if __name__ == "__main__":
    sys.exit(main())
