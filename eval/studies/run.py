"""Runs a study's jobs and leaves its numbers, its figure and where each method breaks."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.outputs import check_files, files_together
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.found_poses import method_on_own_poses
from eventsweep.eval.jobs.job import Done, Failed, Job, Outcome
from eventsweep.eval.jobs.scheduler import Open, run_jobs
from eventsweep.eval.pipeline import check_case
from eventsweep.eval.progress import Display
from eventsweep.eval.scoring.results import POOLED, each
from eventsweep.eval.studies.curves import (
    METRICS,
    POSE_METRICS,
    RobustnessCurve,
    StudyValue,
    curves,
    draw,
    sample_words,
)
from eventsweep.eval.studies.definitions import MARGIN_S, SECONDS, Change, Study
from eventsweep.eval.suite.results import DEFAULT_MAPPER, EVENTS, sample_from
from eventsweep.eval.suite.run import track_job
from eventsweep.eval.suite.stages.simulate import scene_digest, sequence_parameters


@dataclass(frozen=True)
class StudyResult:
    """What a study found; an amount whose job failed has no value.

    Attributes:
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
    study: Study, methods: Sequence[str], cases: Sequence[str], seeds: Sequence[int], workers: Open,
    progress: Display, seconds: float = SECONDS, *, track: str | None = None,
) -> StudyResult:  # fmt: skip
    """Maps and scores every case, seed and amount, in sequences of so many seconds.

    With `track`, a tracker's name, poses are found from the events, too; they, and maps on them,
    are scored.
    """
    jobs = study_jobs(study, methods, cases, seeds, seconds, track=track)
    methods = (*methods, *(method_on_own_poses(name) for name in methods if track))
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
    """Writes NAME.png, NAME.svg, NAME.csv (every number) and NAME.json (curves and provenance).

    A kill leaves the study whole or without its NAME.json, which the next run replaces.
    """
    names = file_names(result.study)
    check_files(folder, names, force=True)
    with files_together(folder, names, index=names[-1]) as staged:
        picture, drawing, numbers, facts = (staged / name for name in names)
        for path in (picture, drawing):
            draw(result.study, result.curves, path, sample_words(result.cases, result.seeds))
        with numbers.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(column.name for column in fields(StudyValue))
            table.writerows(astuple(value) for value in result.values)
        facts.write_text(json.dumps(_facts(result), indent=1) + "\n", encoding="utf-8")
    return [folder / name for name in names]


def file_names(study: Study) -> tuple[str, ...]:
    """What a study writes: picture, drawing, numbers, and curves with provenance."""
    return tuple(f"{study.name}{suffix}" for suffix in (".png", ".svg", ".csv", ".json"))


def _values(
    jobs: Mapping[tuple[str, int, float], Job], outcomes: Mapping[str, Outcome]
) -> Iterator[StudyValue]:
    for (case, seed, amount), job in jobs.items():
        outcome = outcomes[job.name]
        if not isinstance(outcome, Done) or outcome.text is None:
            continue
        _, rows = sample_from(outcome.text)
        drawn = rows["metric"].isin((*METRICS, *POSE_METRICS))
        pooled = rows[(rows["window"] == POOLED) & drawn]
        for row in each(pooled[pooled["method"] != EVENTS]):
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


def study_jobs(
    study: Study, methods: Sequence[str], cases: Sequence[str], seeds: Sequence[int],
    seconds: float = SECONDS, *, track: str | None = None,
) -> dict[tuple[str, int, float], Job]:  # fmt: skip
    """The scoring job of every case, seed and amount, with all that it needs.

    Seeds are of the head motion, the sensor's noise and the perturbation.
    """
    if not seconds > 3 * MARGIN_S:
        raise InputError(f"seconds is {seconds:g}: a study needs more than {3 * MARGIN_S:g}")
    for case in cases:
        check_case(case, None, MapperConfig(methods=tuple(methods)), track=track is not None)
    return {
        (case, seed, amount): _score_job(study, methods, case, seed, amount, seconds, track=track)
        for case in cases
        for seed in seeds
        for amount in study.amounts
    }


def _score_job(
    study: Study, methods: Sequence[str], case: str, seed: int, amount: float, seconds: float, *,
    track: str | None,
) -> Job:  # fmt: skip
    change = study.change(amount)
    length = {"duration_s": seconds, "truth_times_s": [seconds / 2]}
    facts = sequence_parameters(case, None, seed, {**length, **change.sim})
    simulated = f"{case}/seed{seed}"
    place = f"{simulated}/{study.name}={amount:g}"
    sequence = (
        Job(
            f"simulate/{place}",
            "eventsweep.eval.studies.stages.simulate",
            {**facts, "change": change.scene},
        )
        if change.scene or change.sim
        else Job(f"simulate/{simulated}", "eventsweep.eval.suite.stages.simulate", facts)
    )
    mapping = {
        "window": "w000",
        "map": {"methods": list(methods), **window_of(change, seconds)},
        "perturb": change.perturb,
        "seed": seed,
    }
    mapped = Job(f"map/{place}", "eventsweep.eval.suite.stages.map", mapping, (sequence,))
    scoring = {
        "case": case,
        "seed": seed,
        "mappers": [DEFAULT_MAPPER],
        "score": EvalConfig().model_dump(mode="json"),
        "scene_digest": scene_digest(case),
    }
    needs: tuple[Job, ...] = (sequence, mapped)
    if track:
        wrong = {"perturb": change.perturb, "seed": seed}
        needs = (*needs, track_job(place, sequence, [mapped], [DEFAULT_MAPPER], wrong, track))
        scoring["track"] = True
    return Job(f"score/{place}", "eventsweep.eval.suite.stages.score", scoring, needs)


def window_of(change: Change, seconds: float) -> dict[str, Any]:
    """The mapper's settings at an amount: a window about the middle, where the truth is."""
    settings = {"duration_s": seconds - 2 * MARGIN_S, **change.map}
    if settings["duration_s"] > seconds:
        raise InputError(
            f"a window of {settings['duration_s']:g} s in sequences of {seconds:g} s: "
            "make them longer with --seconds"
        )
    start_s = (seconds - settings["duration_s"]) / 2
    return {
        **settings,
        "start_s": round(start_s, 6),
        "duration_s": round(settings["duration_s"], 6),
    }
