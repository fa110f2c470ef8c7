"""Jobs by the batch, for workers to whom handing over takes longer than a small job does.

A batch has a second, or longer where there are many workers: then its worker begins no further job
of it, and the others come back. So how long jobs take need not be known, and one that takes hours
holds up none. What a batch did is in the cache job by job: if its worker dies, only the job that
was being done begins anew.
"""

from __future__ import annotations

import pickle
import queue
import socket
import time
import zlib
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Iterable
from itertools import count
from pathlib import Path
from typing import Any, Protocol

from eventsweep.eval.jobs.job import Failed, Job, Outcome, code_of, do

BATCH_S = 1.0
"""For how long a batch begins jobs, at least."""
MOST = 256
"""Jobs of a batch: what is handed over stays a small message."""
LOSSES = 20
"""How often what came of a batch may be lost on its way, with the scheduler or with the worker that
still had it, before that counts as a try of its jobs."""
_PER_S = 100  # batches that are over: a third of what Dask's scheduler can pass on
_PER_WORKER = 3  # batches handed over and not over
_FETCH_S = 30.0  # for what came of a batch that is over
_MOST_TEXT = 1 << 26  # characters that a batch sends back
Batch = tuple[Job, ...]


class Result(Protocol):
    """A future, as far as it is asked: `concurrent.futures` and Dask have it."""

    def result(self, timeout: float | None = None) -> Any:
        """What the call returned, or its error."""

    def add_done_callback(self, call: Any, /) -> Any:
        """Has it called with the future, once it is over."""


def do_batch(parcel: bytes) -> bytes:
    """Does jobs of a batch, in order, for as long as it has.

    Returns what came of them, and which part of its time that took. Both ways are packed: to the
    scheduler that carries them they are bytes, and a score's text is a tenth of its megabyte.
    """
    begun_s, spent_s, size = time.monotonic(), 0.0, 0
    batch_s, jobs = unpacked(parcel)
    outcomes: list[Outcome] = []
    for job, cache, code in jobs:
        if spent_s >= batch_s or size >= _MOST_TEXT:
            break
        outcomes.append(do_same_code(job, cache, code))
        size += len(getattr(outcomes[-1], "text", None) or "")
        spent_s = time.monotonic() - begun_s
    return packed((outcomes, spent_s / batch_s))


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


def packed(value: object) -> bytes:
    """A value as few bytes."""
    return zlib.compress(pickle.dumps(value), 1)


def unpacked(data: bytes) -> Any:
    """The value that was packed."""
    return pickle.loads(zlib.decompress(data))


class Batches:
    """Jobs that wait, and how many of them make a batch: as many as lately were done in its time.

    It starts with one. A full batch done in less than half its time doubles that; one that is not
    done makes it as small as what was done of it.
    """

    def __init__(self) -> None:
        self._ready: deque[Batch] = deque()
        self._waiting: deque[Job] = deque()
        self._size = 1

    def __bool__(self) -> bool:
        """Whether any job waits."""
        return bool(self._ready or self._waiting)

    def add(self, job: Job) -> None:
        """Puts a job at the end."""
        self._waiting.append(job)

    def again(self, batches: Iterable[Batch]) -> None:
        """Puts batches before everything else, as they are."""
        self._ready.extend(batches)

    def next(self, shares: int) -> Batch:
        """Takes a batch, of no more than a job's share where so many want to have one."""
        if self._ready:
            return self._ready.popleft()
        size = min(self._size, len(self._waiting) // shares + 1, len(self._waiting))
        return tuple(self._waiting.popleft() for _ in range(size))

    def over(self, batch: Batch, done: int, spent: float) -> None:
        """Notes how many jobs of a batch were done, and in which part of its time.

        Those that were not wait again, before all others.
        """
        self._waiting.extendleft(reversed(batch[done:]))
        if done < len(batch):
            self._size = max(done, 1)
        elif done >= self._size and spent < 0.5:
            self._size = min(2 * self._size, MOST)


class BatchWorkers(ABC):
    """Workers that take a batch of jobs and give a future.

    Few batches are handed over at a time, the others wait here.

    Attributes:
        cache: the jobs' cache, as a folder that the workers see; best one that they share.
        held: the batches that are handed over and not over, and their futures, by number.
        least: how many of these there may be, even if few workers are known.
        lost: what a future raises whose jobs are not to blame.
        final: what one raises whose jobs were tried elsewhere already, as often as is good.
    """

    least: int = 32

    lost: tuple[type[Exception], ...] = ()
    final: tuple[type[Exception], ...] = ()

    def __init__(self, cache: Path) -> None:
        self.cache = str(cache)
        self._batches, self._numbers = Batches(), count()
        self.held: dict[int, tuple[Batch, Result]] = {}
        self._over: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._losses: Counter[str] = Counter()

    @property
    @abstractmethod
    def count(self) -> int:
        """How many work now."""

    @abstractmethod
    def start(self, stage: str, parcel: bytes) -> Result:
        """Hands over `do_batch` of a batch that begins with a job of that stage."""

    def check(self) -> None:  # noqa: B027 (most say it by their futures)
        """Takes back, with `take_back`, batches of which nothing can come any more, or raises."""

    def submit(self, job: Job) -> None:
        """Takes a job whose needs are done; `wait` hands it over."""
        self._batches.add(job)

    def wait(self, timeout_s: float) -> list[Outcome]:
        """The outcomes since the last call; waits for one, but no longer than that."""
        self._hand_over()
        try:
            over = [self._over.get(timeout=timeout_s)]
        except queue.Empty:
            self.check()
            return []
        self.check()
        while not self._over.empty():
            over.append(self._over.get())
        outcomes = [outcome for number in over for outcome in self._outcomes(number)]
        self._hand_over()
        return outcomes

    def take_back(self) -> None:
        """Takes back all that is handed over."""
        self._batches.again(batch for batch, _ in self.held.values())
        self.held.clear()

    def _hand_over(self) -> None:
        self.check()
        workers = self.count
        most, batch_s = max(_PER_WORKER * workers, self.least), max(BATCH_S, workers / _PER_S)
        while self._batches and len(self.held) < most:
            batch, number = self._batches.next(most), next(self._numbers)
            jobs = [(job, self.cache, code_of(job)) for job in batch]
            future = self.start(batch[0].stage, packed((batch_s, jobs)))
            self.held[number] = batch, future
            future.add_done_callback(lambda _, number=number: self._over.put(number))

    def _outcomes(self, number: int) -> list[Outcome]:
        """What came of a batch; nothing if that was lost, or its jobs are handed over again."""
        if number not in self.held:
            return []
        batch, future = self.held.pop(number)
        try:
            came: tuple[list[Outcome], float] = unpacked(future.result(timeout=_FETCH_S))
        except Exception as error:  # whatever workers elsewhere can do to jobs
            return self.failed(batch, error)
        outcomes, spent = came
        self._batches.over(batch, len(outcomes), spent)
        return outcomes

    def failed(self, batch: Batch, error: Exception) -> list[Outcome]:
        """Hands a batch over again if it was lost; else each job alone, or gives one up."""
        name, lost = batch[0].name, isinstance(error, self.lost)
        self._losses[name] += lost
        if lost and self._losses[name] <= LOSSES:
            self._batches.again([batch])
            return []
        if len(batch) > 1:
            self._batches.again((job,) for job in batch)
            return []
        reason = " ".join(str(error).split())[:300]
        again = not isinstance(error, self.final)
        return [Failed(name, f"{type(error).__name__}: {reason}", again=again)]
