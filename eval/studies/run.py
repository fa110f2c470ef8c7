"""Runs a study's jobs and leaves its numbers, its figure and where each method breaks."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from emvs.utils.files import atomic_path
from emvs.utils.runtime import versions
from eval.jobs.job import Done, Failed, Job, Outcome
from eval.jobs.scheduler import Open, run_jobs
from eval.progress import Progress
from eval.studies.curves import METRICS, RobustnessCurve, StudyValue, curves
from eval.studies.jobs import study_jobs
from eval.studies.picture import draw, sample_words
from eval.studies.study import SECONDS, Study
from eval.suite.results import sample_from

_POOLED = "all"


@dataclass(frozen=True)
class StudyResult:
    """What a study found.

    Attributes:
        study: what was perturbed.
        curves: per method and metric.
        values: every number behind them.
        failures: per job that failed, why; its amount has no value.
        cases: that were averaged.
        seeds: of each case.
        seconds: length of every sequence, s.
        cpu_s: time of processors that all jobs took, whenever they were done, s.
    """

    study: Study
    curves: tuple[RobustnessCurve, ...]
    values: tuple[StudyValue, ...]
    failures: Mapping[str, str]
    cases: tuple[str, ...]
    seeds: tuple[int, ...]
    seconds: float = SECONDS
    cpu_s: float = 0.0

    def breaking(self) -> dict[str, float | None]:
        """Per method the amount at which it breaks."""
        return {
            curve.method: curve.breaking_amount()
            for curve in self.curves
            if curve.metric == METRICS[0]
        }


def run_study(
    study: Study,
    methods: Sequence[str],
    cases: Sequence[str],
    seeds: Sequence[int],
    workers: Open,
    progress: Progress,
    seconds: float = SECONDS,
) -> StudyResult:
    """Maps and scores every case, seed and amount.

    Args:
        study: what to perturb.
        methods: whose maps are compared.
        cases: scenes.
        seeds: of the head motion, the sensor's noise and the perturbation.
        workers: opens what does the jobs.
        progress: shown how far it is.
        seconds: length of every sequence, s.

    Raises:
        InputError: an unknown case or method, or sequences too short for a window.
    """
    jobs = study_jobs(study, methods, cases, seeds, seconds)
    outcomes = run_jobs(jobs.values(), workers, progress)
    values = tuple(_values(jobs, outcomes))
    return StudyResult(
        study,
        tuple(curves(values, study.amounts, methods, cases)),
        values,
        {one.name: one.reason for one in outcomes.values() if isinstance(one, Failed)},
        tuple(cases),
        tuple(seeds),
        seconds,
        sum(one.cpu_seconds for one in outcomes.values() if isinstance(one, Done)),
    )


def write_study(folder: Path, result: StudyResult) -> list[Path]:
    """Writes NAME.png, NAME.svg, NAME.csv (every number) and NAME.json (curves and provenance)."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [
        folder / f"{result.study.name}{suffix}" for suffix in (".png", ".svg", ".csv", ".json")
    ]
    for path in paths[:2]:
        draw(result.study, result.curves, path, sample_words(result.cases, result.seeds))
    with atomic_path(paths[2]) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(column.name for column in fields(StudyValue))
        table.writerows(astuple(value) for value in result.values)
    with atomic_path(paths[3]) as partial:
        partial.write_text(json.dumps(_facts(result), indent=1) + "\n", encoding="utf-8")
    return paths


def _values(
    jobs: Mapping[tuple[str, int, float], Job], outcomes: Mapping[str, Outcome]
) -> Iterator[StudyValue]:
    for (case, seed, amount), job in jobs.items():
        outcome = outcomes[job.name]
        if not isinstance(outcome, Done) or outcome.text is None:
            continue
        for row in sample_from(outcome.text).rows:
            if row.window == _POOLED and row.metric in METRICS and row.method != "events":
                yield StudyValue(case, seed, amount, row.method, row.metric, row.value, row.unit)


def _facts(result: StudyResult) -> dict[str, Any]:
    study = result.study
    return {
        "study": study.name,
        "axis": study.axis,
        "unit": study.unit,
        "cases": result.cases,
        "seeds": result.seeds,
        "seconds": result.seconds,
        "cpu_s": round(result.cpu_s, 1),
        "amounts": study.amounts,
        "changes": {f"{amount:g}": vars(study.change(amount)) for amount in study.amounts},
        "breaks_at": result.breaking(),
        "curves": [
            {
                "method": curve.method, "metric": curve.metric, "unit": curve.unit,
                "mean": _numbers(curve.mean), "low": _numbers(curve.low),
                "high": _numbers(curve.high), "samples": curve.samples.tolist(),
            }
            for curve in result.curves
        ],
        "failures": dict(result.failures),
        "versions": versions(),
    }  # fmt: skip


def _numbers(values: Any) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]
