"""Jobs on any `concurrent.futures.Executor`: threads, processes, MPI, loky, Ray, Parsl."""

from __future__ import annotations

import queue
import socket
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from eventsweep.emvs.errors import InputError
from eventsweep.eval.jobs.job import Failed, Job, Outcome, code_of, do

LOSSES = 20
"""How often the outcome of a job may be lost on its way, with the scheduler or with the worker that
still had it, before that counts as a try of the job."""
_FETCH_S = 30.0
"""How long the outcome of a job that is over is waited for."""


class Result(Protocol):
    """A future, as far as it is asked: `concurrent.futures` and Dask have it."""

    def result(self, timeout: float | None = None) -> Any:
        """What the call returned, or its error."""

    def add_done_callback(self, call: Any, /) -> Any:
        """Has it called with the future, once it is over."""


class FutureWorkers(ABC):
    """Workers that take a job and give a future.

    Attributes:
        cache: the jobs' cache, as a folder that the workers see; best one that they share.
        lost: what a future raises whose job is not to blame.
        final: what one raises whose job was tried elsewhere already, as often as is good.
    """

    lost: tuple[type[Exception], ...] = (CancelledError, TimeoutError)
    final: tuple[type[Exception], ...] = ()

    def __init__(self, cache: Path) -> None:
        self.cache = str(cache)
        self._over: queue.SimpleQueue[tuple[str, Result]] = queue.SimpleQueue()
        self._futures: dict[str, Result] = {}
        self._jobs: dict[str, Job] = {}
        self._losses: Counter[str] = Counter()

    @property
    @abstractmethod
    def count(self) -> int:
        """How many work now."""

    @abstractmethod
    def start(self, job: Job) -> Result:
        """Hands over `do_same_code` of a job."""

    def check(self) -> None:  # noqa: B027 (most executors say it by their futures)
        """Hands over again the jobs of which nothing can come any more, or raises."""

    def submit(self, job: Job) -> None:
        """Hands over a job whose needs are done."""
        self.check()
        self._begin(job)

    def _begin(self, job: Job) -> None:
        self._jobs[job.name] = job
        future = self._futures[job.name] = self.start(job)
        future.add_done_callback(lambda over, name=job.name: self._over.put((name, over)))

    def wait(self, timeout_s: float) -> list[Outcome]:
        """The outcomes since the last call; waits for one, but no longer than that."""
        try:
            over = [self._over.get(timeout=timeout_s)]
        except queue.Empty:
            self.check()
            return []
        self.check()
        while not self._over.empty():
            over.append(self._over.get())
        outcomes: list[Outcome | None] = []
        for name, future in over:
            if self._futures.get(name) is future:  # others were handed over again
                outcomes.append(self._outcome(name, future))
        return [one for one in outcomes if one is not None]

    def _outcome(self, name: str, future: Result) -> Outcome | None:
        """What came of a job; None if that was lost and the job handed over again."""
        try:
            outcome: Outcome = future.result(timeout=_FETCH_S)
        except BrokenExecutor as error:
            raise InputError(
                f"the executor is broken ({' '.join(str(error).split()) or 'a worker died'}): open "
                "a new one and call again; finished jobs are in the cache"
            ) from error
        except Exception as error:  # whatever workers elsewhere can do to a job
            self._losses[name] += isinstance(error, self.lost)
            if isinstance(error, self.lost) and self._losses[name] <= LOSSES:
                self.submit(self._jobs[name])
                return None
            reason = " ".join(str(error).split())[:300]
            again = not isinstance(error, self.final)
            outcome = Failed(name, f"{type(error).__name__}: {reason}", again=again)
        del self._futures[name], self._jobs[name]
        return outcome


class ExecutorWorkers(FutureWorkers):
    """Those of an executor, which stays open.

    Attributes:
        count: how many work at once, as its owner says: only the time left depends on it.
    """

    count: int = 1

    def __init__(self, executor: Executor, cache: Path, count: int = 1) -> None:
        super().__init__(cache)
        self._executor, self.count = executor, count

    def start(self, job: Job) -> Result:
        """Hands over a job; it runs with this code or not at all."""
        try:
            return self._executor.submit(do_same_code, job, self.cache, code_of(job))
        except RuntimeError as error:  # shut down, or broken
            reason = " ".join(str(error).split())
            raise InputError(
                f"the executor takes no job ({reason}): open a new one and call again; finished "
                "jobs are in the cache"
            ) from error

    def end(self) -> None:
        """Takes back the jobs that did not begin."""
        for future in self._futures.values():
            cancel = getattr(future, "cancel", None)
            if cancel is not None:
                cancel()


@contextmanager
def executor_workers(executor: Executor, cache: Path, count: int = 1) -> Iterator[ExecutorWorkers]:
    """Workers of an executor; what did not begin is taken back if the work ends before it."""
    workers = ExecutorWorkers(executor, cache, count)
    try:
        yield workers
    finally:
        workers.end()


def do_same_code(job: Job, cache: str, code: str) -> Outcome:
    """Does a job, unless this machine would do it with other code."""
    here = code_of(job)
    if here != code:
        return Failed(
            job.name,
            f"worker {socket.gethostname()} runs different code ({here}, not {code}): install "
            "the same version on all machines",
        )
    return do(job, cache)
