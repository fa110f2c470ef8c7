"""Runs a suite, or a subset of one, as a graph of jobs, and collects what they scored."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from eventsweep.eval.jobs.job import Done, Failed, Job, Outcome
from eventsweep.eval.jobs.scheduler import Open, run_jobs
from eventsweep.eval.progress import Display
from eventsweep.eval.results.results import JobNote, Results, joined, results_from
from eventsweep.eval.scoring.predictions import NamedFolder
from eventsweep.eval.suite.definition import Suite
from eventsweep.eval.suite.plan import extent, suite_jobs
from eventsweep.eval.suite.predictions import assignment, beside_job, open_predictions
from eventsweep.eval.suite.source import SequenceSource

_ABOUT = ["case", "seed", "window", "method", "metric"]


def run_suite(
    suite: Suite, subset: str, workers: Open, progress: Display, *,
    seeds: Sequence[int] | None = None, cases: Sequence[str] | None = None,
    predictions: Sequence[NamedFolder] = (), archive: SequenceSource | None = None,
) -> Results:  # fmt: skip
    """Does all jobs of a suite's subset, or of some of its cases and other seeds.

    Failed jobs are in the result. Depth maps in the folders of predictions are scored beside the
    suite's methods; sequences are those of the archive, or simulated.
    """
    its_cases, its_seeds = extent(suite, subset, seeds, cases, archive)
    jobs = suite_jobs(suite, its_cases, its_seeds, archive)
    # Of a model one must look around to say what is asked for: seconds for each case and seed.
    facts = (job.parameters for job in jobs) if predictions else ()
    asked = [assignment(suite, each["case"], each["seed"]) for each in facts]
    others = open_predictions(predictions, suite, asked)
    beside = [beside_job(others, job) for job in jobs] if others else []
    jobs += [*(other.job(job) for job in jobs for other in others), *beside]
    outcomes = run_jobs(jobs, workers, progress)
    return collected(
        jobs,
        outcomes,
        suite=suite.name,
        subset=subset,
        digest=suite.digest,
        definition=suite.model_dump(mode="json"),
        cases={case: suite.digest_of(case) for case in its_cases},
        seeds=its_seeds,
        predictions={other.name: other.digest for other in others},
        archive=archive.facts if archive else None,
    )


def collected(jobs: Sequence[Job], outcomes: Mapping[str, Outcome], **about: Any) -> Results:
    """What scoring jobs say as one table, in the order of the jobs; each case and seed together."""
    texts = [(job, done.text) for job in jobs if isinstance(done := outcomes[job.name], Done)]
    parts = [_asked(results_from(json.loads(text)), job) for job, text in texts if text]
    notes = tuple(map(_note, outcomes.values()))
    found = joined(parts, jobs=notes, **about)
    # Beside predictions, the maps are compared on other pixels than among themselves.
    rows = found.rows.drop_duplicates(_ABOUT, keep="last", ignore_index=True)
    return replace(found, rows=rows, configuration={})


def _asked(part: Results, job: Job) -> Results:
    """A part under the seed that was asked for: of a hidden one its number, not the seed itself."""
    seed = job.parameters.get("seed")
    if seed is None or part.seed in (None, seed):
        return part
    samples = tuple(replace(sample, seed=seed) for sample in part.samples)
    return replace(part, rows=part.rows.assign(seed=seed), samples=samples)


def _note(outcome: Outcome) -> JobNote:
    if isinstance(outcome, Failed):
        return JobNote(outcome.name, failure=outcome.reason, log=outcome.log)
    return JobNote(
        outcome.name, outcome.key, outcome.code, round(outcome.seconds, 3), outcome.found,
        cpu_seconds=round(outcome.cpu_seconds, 3),
    )  # fmt: skip
