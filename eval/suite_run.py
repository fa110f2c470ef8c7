"""Runs a suite, or a subset of one, wherever its jobs may be done, and collects the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from emvs.errors import InputError
from eval.jobs.job import Done, Failed, Job, Outcome
from eval.jobs.scheduler import Open, run_jobs
from eval.progress import Progress
from eval.suite import Suite
from eval.suite_jobs import suite_jobs
from eval.suite_rows import JobNote, Sample, SuiteResult, sample_from


def run_suite(
    suite: Suite,
    subset: str,
    workers: Open,
    progress: Progress,
    *,
    seeds: Sequence[int] | None = None,
    cases: Sequence[str] | None = None,
) -> SuiteResult:
    """Does all jobs of a suite's subset; failed ones are in the result.

    Args:
        suite: the definition.
        subset: what of it.
        workers: opens what does the jobs.
        progress: shown how far it is.
        seeds: seeds instead of the subset's own.
        cases: some of the subset's cases.

    Raises:
        InputError: an unknown case, scene, rig or method.
    """
    chosen = suite.subset(subset)
    its_cases = _chosen(chosen.cases, cases)
    its_seeds = tuple(chosen.seeds if seeds is None else seeds)
    jobs = suite_jobs(suite, its_cases, its_seeds)
    outcomes = run_jobs(jobs, workers, progress)
    return SuiteResult(
        suite=suite.name,
        subset=subset,
        digest=suite.digest,
        definition=suite.model_dump(mode="json"),
        cases={case: suite.digest_of(case) for case in its_cases},
        seeds=its_seeds,
        samples=tuple(_samples(jobs, outcomes)),
        jobs=tuple(_note(outcome) for outcome in outcomes.values()),
    )


def _chosen(known: Sequence[str], asked: Sequence[str] | None) -> tuple[str, ...]:
    for case in asked or ():
        if case not in known:
            raise InputError(f"no case {case!r} here: choose from {', '.join(known)}")
    return tuple(case for case in known if not asked or case in asked)


def _samples(jobs: Sequence[Job], outcomes: Mapping[str, Outcome]) -> list[Sample]:
    over = [outcomes[job.name] for job in jobs]
    return [sample_from(one.text) for one in over if isinstance(one, Done) and one.text]


def _note(outcome: Outcome) -> JobNote:
    if isinstance(outcome, Failed):
        return JobNote(outcome.name, failure=outcome.reason)
    return JobNote(
        outcome.name,
        outcome.key,
        outcome.code,
        round(outcome.seconds, 3),
        outcome.found,
        cpu_seconds=round(outcome.cpu_seconds, 3),
    )
