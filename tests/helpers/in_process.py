"""Runs jobs in the process of the test: most tests ask what jobs make, not where they run."""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from eventsweep.eval.jobs.job import Job, Outcome, do


class InProcess:
    """Workers as the scheduler asks for them, without a process: a job is done when waited for."""

    count = 1

    def __init__(self, cache: Path) -> None:
        self._cache, self._waiting = cache, deque[Job]()

    def submit(self, job: Job) -> None:
        self._waiting.append(job)

    def wait(self, timeout_s: float) -> list[Outcome]:
        del timeout_s
        return [do(self._waiting.popleft(), str(self._cache))] if self._waiting else []


@contextmanager
def in_process(count: int, cache: Path) -> Iterator[InProcess]:
    """Takes the place of `local_workers`."""
    del count
    yield InProcess(cache)
