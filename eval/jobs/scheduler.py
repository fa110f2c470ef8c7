"""Runs a graph of jobs somewhere: each when all that it needs is done; no failure stops others."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from eventsweep.eval.jobs.job import Failed, Job, Outcome, order
from eventsweep.eval.progress import Display


class Workers(Protocol):
    """Where jobs are done."""

    @property
    def count(self) -> int:
        """How many work now."""

    def submit(self, job: Job) -> None:
        """Hands over a job whose needs are done."""

    def wait(self, timeout_s: float) -> list[Outcome]:
        """The outcomes since the last call; waits for one, but no longer than that."""


Open = Callable[[], AbstractContextManager[Workers]]

_TICK_S = 0.5


ATTEMPTS = 2
"""How often a job is tried that ends in an error which another try, elsewhere, might not meet."""


class JobBoard:
    """Who waits for what, and how far everything is.

    Every step costs the same however many jobs there are: a hundred thousand must not take their
    scheduler longer, each, than ten.

    Attributes:
        jobs: in an order in which what is needed comes first.
        outcomes: those that are over, by name.
        running: names of those handed over.
        failures: every failure but those of jobs that could not start.
    """

    def __init__(self, jobs: Sequence[Job]) -> None:
        self.jobs, self.outcomes, self.running = jobs, dict[str, Outcome](), set[str]()
        self.failures: list[Failed] = []
        self._by_name = {job.name: job for job in jobs}
        self._missing = {job.name: len({need.name for need in job.needs}) for job in jobs}
        self._users: dict[str, list[Job]] = {job.name: [] for job in jobs}
        for job in jobs:
            for need in {need.name for need in job.needs}:
                self._users[need].append(job)
        self._ready = deque(job for job in jobs if not job.needs)
        self._tries: Counter[str] = Counter()
        self._left = Counter(job.stage for job in jobs)
        self._took: dict[str, _Mean] = {}

    def start(self) -> Iterator[Job]:
        """Jobs that can start and are running from now on."""
        while self._ready:
            job = self._ready.popleft()
            self.running.add(job.name)
            yield job

    def take(self, outcome: Outcome) -> bool:
        """Notes that a job is over, or is tried again; returns whether it is over."""
        job = self._by_name[outcome.name]
        self.running.discard(job.name)
        if isinstance(outcome, Failed) and outcome.again:
            self._tries[job.name] += 1
            if self._tries[job.name] < ATTEMPTS:
                self._ready.append(job)
                return False
        if isinstance(outcome, Failed):
            self.failures.append(outcome)
        else:
            mean = self._took.setdefault(job.stage, _Mean())
            mean.add(0.0 if outcome.found else outcome.seconds)
        self._end(job, outcome)
        return True

    def _end(self, job: Job, outcome: Outcome) -> None:
        """What waits for a job can start, or cannot any more."""
        ended = deque([(job, outcome)])
        while ended:
            job, outcome = ended.popleft()
            self.outcomes[job.name] = outcome
            self._left[job.stage] -= 1
            for user in self._users[job.name]:
                self._missing[user.name] -= 1
                if isinstance(outcome, Failed):
                    if user.name not in self.outcomes:
                        reason = outcome.reason.removeprefix("not started: ")
                        self.outcomes[user.name] = Failed(user.name, f"not started: {reason}")
                        ended.append((user, self.outcomes[user.name]))
                elif not self._missing[user.name] and user.name not in self.outcomes:
                    self._ready.append(user)

    def words(self, workers: int) -> str:
        """How far it is, in a few words."""
        done, total = len(self.outcomes), len(self.jobs)
        words = f"{done}/{total} jobs, {len(self.running)} running, {len(self.failures)} failed"
        words += "" if workers else ", no worker yet"
        left_s = self._left_s(workers)
        return f"{words}, {left_s:.0f} s left" if done < total and left_s is not None else words

    def _left_s(self, workers: int) -> float | None:
        """From what jobs of each stage took so far; None before the first of them is done."""
        if not self._took:
            return None
        everything = sum(mean.total for mean in self._took.values())
        mean_s = everything / sum(mean.count for mean in self._took.values())
        left_s = sum(
            count * (self._took[stage].value if stage in self._took else mean_s)
            for stage, count in self._left.items()
        )
        return left_s / max(workers, 1)


@dataclass
class _Mean:
    total: float = 0.0
    count: int = 0

    def add(self, value: float) -> None:
        self.total, self.count = self.total + value, self.count + 1

    @property
    def value(self) -> float:
        return self.total / self.count


def run_jobs(
    jobs: Iterable[Job], workers: Open, progress: Display,
    over: Callable[[Outcome], None] = lambda _outcome: None,
) -> Mapping[str, Outcome]:  # fmt: skip
    """Does jobs and all that they need; returns the outcome of each, by name.

    `over` is called with the outcome of each job that ran, when it is over.

    A job that ends in an error which its code did not foresee is tried once more, by whichever
    worker takes it; bad input is not.
    """
    board = JobBoard(order(jobs))
    with workers() as crew, progress.stage("jobs", max(len(board.jobs), 1)) as update:
        while len(board.outcomes) < len(board.jobs):
            for job in board.start():
                crew.submit(job)
            if board.running:
                for outcome in _collect(board, crew, progress):
                    over(outcome)
            update(len(board.outcomes), board.words(crew.count))
    return board.outcomes


def _collect(board: JobBoard, crew: Workers, progress: Display) -> Iterator[Outcome]:
    """The outcomes of jobs that are over since the last call."""
    for outcome in crew.wait(_TICK_S):
        over = board.take(outcome)
        if over:
            yield outcome
        if isinstance(outcome, Failed):
            again = "" if over else "; it is tried again"
            progress.say(f"failed: {outcome.name}: {outcome.reason}{again}")
