"""Whether jobs survive a cluster whose workers, and once its scheduler, are killed.

    python tests/benchmarks kill_workers [--minutes 5] [--every-s 10] [--workers 4] [--within-s S]

For some minutes a random worker is killed (SIGKILL) time and again and another one started; half
way the scheduler and all workers are. The jobs are a suite's: sequences, their windows, and a score
of both. They are shorter than the time between kills: a job that is longer never ends anywhere.
Every job must be done, once in the results and once in the cache, with the bytes that one process
makes. If work is left some time after the last kill, the tool says how much, and exits with 1.
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

from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval.jobs.dask import Cluster, dask_workers
from eventsweep.eval.jobs.job import Done, Job, Outcome, do
from eventsweep.eval.jobs.scheduler import run_jobs
from eventsweep.eval.progress import SILENT

_JOB_S, _WINDOWS = 2.0, 6
_ROOT = Path(__file__).resolve().parents[3]


class Victims:
    """A scheduler and its workers, processes of this one, which it kills and starts anew."""

    def __init__(self, workers: int) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = int(free.getsockname()[1])
        self.address, self.deaths = f"tcp://127.0.0.1:{self.port}", 0
        search = f"{_ROOT / 'tests' / 'helpers'}{os.pathsep}{_ROOT}"
        self._environment = {**os.environ, "PYTHONPATH": search}
        self._scheduler = self._start_scheduler()
        self._workers = [self._start_worker() for _ in range(workers)]

    @property
    def scheduler(self) -> int:
        """The scheduler's process."""
        return self._scheduler.pid

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


class Killing(threading.Thread):
    """Kills for some minutes, or until the work is over.

    Attributes:
        over: set when nobody is to be killed any more.
        last_s: when the last of them was, on the monotonic clock.
    """

    def __init__(self, victims: Victims, minutes: float, every_s: float) -> None:
        super().__init__(daemon=True)
        self.over, self.last_s = threading.Event(), time.monotonic()
        self._victims, self._minutes, self._every_s = victims, minutes, every_s

    def run(self) -> None:
        """Kills, once the scheduler too."""
        half_s, end_s = (self.last_s + share * 60 * self._minutes for share in (0.5, 1.0))
        while not self.over.wait(self._every_s) and time.monotonic() <= end_s:
            if half_s and time.monotonic() > half_s:
                self._victims.kill_scheduler()
                half_s = 0.0
            self._victims.kill_worker()
            self.last_s = time.monotonic()


class Working(threading.Thread):
    """Does jobs on a cluster.

    Attributes:
        over: what came of them so far, in the order in which it came.
        error: what ended the work before they were all over.
    """

    def __init__(self, jobs: list[Job], cluster: Cluster, cache: Path) -> None:
        super().__init__(daemon=True)  # what stalls must not keep this process
        self.over, self.error = list[Outcome](), ""
        self._jobs, self._cluster, self._cache = jobs, cluster, cache

    def run(self) -> None:
        """Does them."""
        crew = lambda: dask_workers(self._cluster, self._cache)  # noqa: E731
        try:
            run_jobs(self._jobs, crew, SILENT, self.over.append)
        except Exception as error:
            self.error = f" ({type(error).__name__}: {error})"


def graph(count: int, seconds: float, log: Path) -> list[Job]:
    """About so many jobs: a sequence, the windows that need it, the score that needs them all."""

    def job(name: str, *needs: Job) -> Job:
        facts = {"id": name, "act": "sleep", "seconds": seconds, "log": str(log)}
        return Job(name, "job_stages", facts, needs)

    jobs: list[Job] = []
    for k in range(max(round(count / (_WINDOWS + 2)), 1)):
        sequence = job(f"sequence{k:03d}")
        windows = [job(f"map{k:03d}w{w}", sequence) for w in range(_WINDOWS)]
        jobs += [sequence, *windows, job(f"score{k:03d}", sequence, *windows)]
    return jobs


def done(working: Working, killing: Killing, within_s: float) -> bool:
    """Waits until the work is over, or not some time after the last kill; returns whether it is."""
    for thread in (working, killing):
        thread.start()
    while working.is_alive() and (
        killing.is_alive() or time.monotonic() < killing.last_s + within_s
    ):
        working.join(0.2)
    killing.over.set()
    killing.join()
    return not working.is_alive() and not working.error


def check(jobs: list[Job], over: list[Outcome], folder: Path) -> None:
    """Raises AssertionError unless each job was done once, with the bytes of one process."""
    failed = [one for one in over if not isinstance(one, Done)]
    assert not failed, f"{len(failed)} of {len(jobs)} jobs failed, such as {failed[0]}"
    assert sorted(one.name for one in over) == sorted(job.name for job in jobs)
    alone = [do(job, str(folder / "alone")) for job in graph(len(jobs), 0.0, folder / "other log")]
    digests = [
        {one.name: one.digest for one in all_ if isinstance(one, Done)} for all_ in (over, alone)
    ]
    assert digests[0] == digests[1], "bytes differ from those of one process"
    entries = len(list(Cache(folder / "cache").folder.glob("??/*/entry.json")))
    assert entries == len(jobs), f"{entries} entries of {len(jobs)} jobs"


def run(minutes: float, every_s: float, workers: int, within_s: float, folder: Path) -> str:
    """Runs the jobs among kills; returns what happened in a line, or exits with one."""
    jobs = graph(round(workers * 60 * minutes / _JOB_S), _JOB_S, folder / "log")
    victims, started_s = Victims(workers), time.monotonic()
    killing = Killing(victims, minutes, every_s)
    working = Working(jobs, Cluster(victims.address), folder / "cache")
    try:
        if not done(working, killing, within_s):
            left = sorted({job.name for job in jobs} - {one.name for one in working.over})
            since_s = time.monotonic() - killing.last_s
            sys.exit(
                f"{len(left)} of {len(jobs)} jobs are not over {since_s:.0f} s after the last of "
                f"{victims.deaths} kills, such as {left[0]}{working.error}"
            )
    finally:
        victims.end()
    took_s = time.monotonic() - started_s
    check(jobs, working.over, folder)
    begun = len(list((folder / "log").iterdir()))
    return (
        f"{len(jobs)} jobs of {_JOB_S:g} s on {workers} workers in {took_s:.0f} s: "
        f"{victims.deaths} workers and the scheduler killed, {begun - len(jobs)} jobs begun again, "
        "nothing lost, doubled or changed"
    )


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=5.0, help="of kills, and of work in all")
    parser.add_argument("--every-s", type=float, default=10.0, help="between two kills")
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument(
        "--within-s", type=float, help="from the last kill to the end (all the work, and a minute)"
    )
    asked = parser.parse_args()
    within_s = 60 * asked.minutes + 60 if asked.within_s is None else asked.within_s
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        line = run(asked.minutes, asked.every_s, asked.workers, within_s, Path(folder))
    sys.stdout.write(f"{line}\n")


if __name__ == "__main__":
    main()
