"""Runs a graph of jobs somewhere: each when all that it needs is done; no failure stops others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
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


@dataclass
class JobBoard:
    """Who waits for what, and how far everything is.

    Jobs are in an order in which what is needed comes first; outcomes are those that are over, by
    name.
    """

    jobs: Sequence[Job]
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    running: set[str] = field(default_factory=set)

    def ready(self) -> Iterator[Job]:
        """Jobs that can start; those whose needs failed fail here."""
        for job in self.jobs:
            if job.name in self.outcomes or job.name in self.running:
                continue
            over = [self.outcomes.get(need.name) for need in job.needs]
            failed = [outcome for outcome in over if isinstance(outcome, Failed)]
            if failed:
                reason = failed[0].reason.removeprefix("not started: ")
                self.outcomes[job.name] = Failed(job.name, f"not started: {reason}")
            elif None not in over:
                yield job

    def take(self, outcome: Outcome) -> None:
        """Notes that a job is over."""
        self.running.discard(outcome.name)
        self.outcomes[outcome.name] = outcome

    @property
    def failed(self) -> list[Failed]:
        """Every failure but those of jobs that could not start."""
        failures = [outcome for outcome in self.outcomes.values() if isinstance(outcome, Failed)]
        return [outcome for outcome in failures if not outcome.reason.startswith("not started: ")]

    def words(self, workers: int) -> str:
        """How far it is, in a few words."""
        done, total = len(self.outcomes), len(self.jobs)
        words = f"{done}/{total} jobs, {len(self.running)} running, {len(self.failed)} failed"
        words += "" if workers else ", no worker yet"
        left_s = _left_s(self, workers)
        return f"{words}, {left_s:.0f} s left" if done < total and left_s is not None else words


def run_jobs(jobs: Iterable[Job], workers: Open, progress: Display) -> Mapping[str, Outcome]:
    """Does jobs and all that they need; returns the outcome of each, by name."""
    board = JobBoard(order(jobs))
    with workers() as crew, progress.stage("jobs", max(len(board.jobs), 1)) as update:
        while len(board.outcomes) < len(board.jobs):
            for job in list(board.ready()):
                board.running.add(job.name)
                crew.submit(job)
            if board.running:
                _collect(board, crew, progress)
            update(len(board.outcomes), board.words(crew.count))
    return board.outcomes


def _collect(board: JobBoard, crew: Workers, progress: Display) -> None:
    for outcome in crew.wait(_TICK_S):
        board.take(outcome)
        if isinstance(outcome, Failed):
            progress.say(f"failed: {outcome.name}: {outcome.reason}")


def _left_s(board: JobBoard, workers: int) -> float | None:
    """From what jobs of each stage took so far; None before the first of them is done."""
    took: dict[str, list[float]] = {}
    stages = {job.name: job.stage for job in board.jobs}
    for outcome in board.outcomes.values():
        if not isinstance(outcome, Failed):
            seconds = 0.0 if outcome.found else outcome.seconds
            took.setdefault(stages[outcome.name], []).append(seconds)
    if not took:
        return None
    everything = [seconds for group in took.values() for seconds in group]
    mean_s = sum(everything) / len(everything)
    left = [job for job in board.jobs if job.name not in board.outcomes]
    each = (sum(took[j.stage]) / len(took[j.stage]) if j.stage in took else mean_s for j in left)
    return sum(each) / max(workers, 1)
