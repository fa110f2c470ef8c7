"""Whether jobs survive a cluster whose workers, and once its scheduler, are killed.

    python tests/benchmarks kill_workers [--minutes 5] [--every-s 10] [--workers 4]

A random worker is killed (SIGKILL) time and again and another one started; half way the scheduler
and all workers are. Every job must be done, once in the results and once in the cache, with the
bytes that one process makes.
"""

from __future__ import annotations

import argparse
import os
import random
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import job_stages
from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval.jobs.dask import Cluster, dask_workers
from eventsweep.eval.jobs.job import Done, Job, do
from eventsweep.eval.jobs.scheduler import run_jobs
from eventsweep.eval.progress import SILENT

_JOB_S, _NEEDS = 2.0, 3


class Victims:
    """A scheduler and its workers, processes of this one, which it kills and starts anew."""

    def __init__(self, workers: int) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = int(free.getsockname()[1])
        self.address, self.deaths = f"tcp://127.0.0.1:{self.port}", 0
        helpers = Path(job_stages.__file__).parent
        self._environment = {
            **os.environ, "PYTHONPATH": f"{helpers}{os.pathsep}{helpers.parents[1]}",
            # A job may lose many a worker through no fault of its own.
            "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "99",
        }  # fmt: skip
        self._scheduler = self._start_scheduler()
        self._workers = [self._start_worker() for _ in range(workers)]

    def kill_worker(self) -> None:
        """Kills one of the workers, and starts another."""
        k = random.randrange(len(self._workers))
        _kill(self._workers[k])
        self._workers[k], self.deaths = self._start_worker(), self.deaths + 1

    def kill_scheduler(self) -> None:
        """Kills the scheduler, whose workers end with it; starts all anew at the same address."""
        for process in (self._scheduler, *self._workers):
            _kill(process)
        self._scheduler = self._start_scheduler()
        self._workers = [self._start_worker() for _ in self._workers]

    def end(self) -> None:
        """Kills all."""
        for process in (*self._workers, self._scheduler):
            _kill(process)

    def _start_scheduler(self) -> subprocess.Popen[bytes]:
        started = self._start("scheduler", "--host", "127.0.0.1", "--port", str(self.port))
        while True:  # a worker that finds none gives up
            with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1):
                return started
            time.sleep(0.2)

    def _start_worker(self) -> subprocess.Popen[bytes]:
        return self._start("worker", self.address, "--nthreads", "1", "--no-nanny")

    def _start(self, what: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard", *words]
        return subprocess.Popen(command, env=self._environment, stderr=subprocess.DEVNULL)


def _kill(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()


def graph(count: int, seconds: float, log: Path) -> list[Job]:
    """Jobs in a chain of layers, each of which needs some of the layer before."""
    jobs: list[Job] = []
    for k in range(count):
        needs = tuple(jobs[j] for j in range(k - 8, k - 8 + _NEEDS) if j >= 0)
        facts = {"id": f"j{k:05d}", "act": "sleep", "seconds": seconds, "log": str(log)}
        jobs.append(Job(f"j{k:05d}", "job_stages", facts, needs))
    return jobs


def run(minutes: float, every_s: float, workers: int, folder: Path) -> str:
    """Runs the jobs among kills; returns what happened in a line, or raises AssertionError."""
    jobs = graph(round(workers * 60 * minutes / _JOB_S), _JOB_S, folder / "log")
    victims, over = Victims(workers), threading.Event()

    def kill() -> None:
        half_s = time.monotonic() + 30 * minutes
        while not over.wait(every_s):
            if half_s and time.monotonic() > half_s:
                victims.kill_scheduler()
                half_s = 0.0
            victims.kill_worker()

    killer = threading.Thread(target=kill)
    killer.start()
    started_s = time.monotonic()
    try:
        cluster = Cluster(victims.address)
        outcomes = run_jobs(jobs, lambda: dask_workers(cluster, folder / "cache"), SILENT)
    finally:
        over.set()
        killer.join()
        victims.end()
    took_s = time.monotonic() - started_s
    failed = [one for one in outcomes.values() if not isinstance(one, Done)]
    assert not failed, f"{len(failed)} of {len(jobs)} jobs failed, such as {failed[0]}"
    digests = {name: one.digest for name, one in outcomes.items() if isinstance(one, Done)}
    alone = [do(job, str(folder / "alone")) for job in graph(len(jobs), 0.0, folder / "log")]
    assert digests == {one.name: one.digest for one in alone if isinstance(one, Done)}
    entries = len(list(Cache(folder / "cache").folder.glob("??/*/entry.json")))
    assert entries == len(jobs), f"{entries} entries of {len(jobs)} jobs"
    return (
        f"{len(jobs)} jobs of {_JOB_S:g} s on {workers} workers in {took_s:.0f} s: "
        f"{victims.deaths} workers and the scheduler killed, nothing lost, doubled or changed"
    )


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=5.0, help="of work, were nobody killed")
    parser.add_argument("--every-s", type=float, default=10.0)
    parser.add_argument("--workers", type=int, default=4)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        line = run(asked.minutes, asked.every_s, asked.workers, Path(folder))
    sys.stdout.write(f"{line}\n")


if __name__ == "__main__":
    main()
