"""Jobs in processes on this machine, each with one thread; a process that dies is replaced."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path

from eventsweep.emvs.utils.cache import Cache
from eventsweep.emvs.utils.processes import check_guard, end_with_parent
from eventsweep.eval.jobs.job import NOT_YET, Done, Failed, Job, Outcome, do, find

# One thread per worker: the jobs are the parallelism. Mesa's rasteriser counts helpers beside the
# calling thread, the others count all threads.
ONE_THREAD = {
    "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1", "LP_NUM_THREADS": "0",
}  # fmt: skip
ATTEMPTS = 3
"""How often a job may take its worker down before it counts as failed."""


def default_workers() -> int:
    """As many as processors that this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def local_workers(count: int, cache: Path) -> Iterator[LocalWorkers]:
    """Opens `count` worker processes, and ends them."""
    with closing(LocalWorkers(count, cache)) as workers:
        yield workers


class LocalWorkers:
    """At most `count` worker processes, started when there is work for them."""

    def __init__(self, count: int, cache: Path) -> None:
        check_guard()
        self.count, self._cache = count, Cache(cache)
        self._over: list[Outcome] = []
        self._digests: dict[str, str] = {}
        self._waiting: deque[Job] = deque()
        self._deaths: dict[str, int] = {}
        self._workers: list[_Worker] = []

    def submit(self, job: Job) -> None:
        """Queues a job, unless the cache has it: that needs no worker, nor time to start one."""
        found = find(job, self._cache, self._digests)
        if found is not None:
            self._over.append(found)
            self._digests[job.name] = found.digest
            return
        self._waiting.append(job)
        self._hand_out()

    def wait(self, timeout_s: float) -> list[Outcome]:
        """The outcomes since the last call; waits for one, but no longer than that."""
        over, self._over = self._over, []
        if over:
            return over
        busy = {id(worker.pipe): (worker, worker.job) for worker in self._workers if worker.job}
        ready = wait([worker.pipe for worker, _ in busy.values()], timeout_s)
        outcomes = [self._outcome_of(*busy[id(pipe)]) for pipe in ready]
        self._hand_out()
        finished = [outcome for outcome in outcomes if outcome is not None]
        self._digests |= {one.name: one.digest for one in finished if isinstance(one, Done)}
        return finished

    def close(self) -> None:
        """Ends every worker, in the middle of its job if it has one."""
        for worker in self._workers:
            worker.end()
        self._workers = []

    def _outcome_of(self, worker: _Worker, job: Job) -> Outcome | None:
        """What a worker says of its job; None if it died and the job is to be tried again."""
        worker.job = None
        try:
            outcome: Outcome = worker.pipe.recv()
        except (EOFError, OSError):
            return self._buried(worker, job)
        return outcome

    def _buried(self, worker: _Worker, job: Job) -> Outcome | None:
        how = worker.end()
        self._workers.remove(worker)
        deaths = self._deaths[job.name] = self._deaths.get(job.name, 0) + 1
        if deaths < ATTEMPTS:
            self._waiting.appendleft(job)
            return None
        return Failed(job.name, f"its worker died {deaths} times, last {how}")

    def _hand_out(self) -> None:
        while self._waiting:
            idle = next((worker for worker in self._workers if worker.job is None), None)
            if idle is None:
                if len(self._workers) >= self.count:
                    return
                idle = _Worker(self._cache.folder)
                self._workers.append(idle)
            idle.start(self._waiting.popleft())


class FoundJobs:
    """Workers that do nothing: a job is over if it was done before, and else not yet."""

    count = 1

    def __init__(self, cache: Path) -> None:
        self._cache = Cache(cache)
        self._over: list[Outcome] = []
        self._digests: dict[str, str] = {}

    def submit(self, job: Job) -> None:
        """Looks a job up."""
        found = find(job, self._cache, self._digests)
        if found is not None:
            self._digests[job.name] = found.digest
        self._over.append(found or Failed(job.name, NOT_YET))

    def wait(self, timeout_s: float) -> list[Outcome]:  # noqa: ARG002
        """What was looked up since the last call."""
        over, self._over = self._over, []
        return over


class _Worker:
    """One process and the job that it does now."""

    def __init__(self, cache: Path) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process: SpawnProcess = context.Process(
            target=_work, args=(theirs, str(cache)), daemon=True
        )
        # Inherited: numba reads it when it is loaded, and that is before the worker's own code.
        with environment(ONE_THREAD):
            self.process.start()
        theirs.close()
        self.job: Job | None = None

    def start(self, job: Job) -> None:
        self.job = job
        with suppress(OSError):  # it died while idle: `wait` will see that
            self.pipe.send(job)

    def end(self) -> str:
        self.pipe.close()
        self.process.join(0.2)
        if self.process.is_alive():
            self.process.terminate()
            self.process.join()
        code = self.process.exitcode or 0
        return f"by signal {-code}" if code < 0 else f"with exit code {code}"


@contextmanager
def environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Sets environment variables for processes that start meanwhile."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _work(pipe: Connection, cache: str) -> None:
    """A worker's whole life: jobs come through the pipe, outcomes go back, until it is closed."""
    end_with_parent()
    with suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            pipe.send(do(pipe.recv(), cache))
