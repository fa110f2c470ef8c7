"""Runs a study as a suite with one more axis, and leaves its numbers, its figure and its curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.outputs import check_files, files_together
from eventsweep.eval.found_poses import method_on_own_poses
from eventsweep.eval.jobs.scheduler import Open
from eventsweep.eval.progress import Display
from eventsweep.eval.results.results import Results, to_json
from eventsweep.eval.results.table import EVENTS, POOLED, write_csv
from eventsweep.eval.studies.curves import (
    METRICS,
    POSE_METRICS,
    RobustnessCurve,
    curves,
    draw,
    sample_words,
)
from eventsweep.eval.studies.definitions import MARGIN_S, SECONDS, Change, Study, study_named
from eventsweep.eval.suite.definition import ALL, CaseSpec, Suite, WindowSpec
from eventsweep.eval.suite.run import run_suite

if TYPE_CHECKING:
    import pandas as pd

_CSV_COLUMNS = ["case", "seed", "amount", "method", "metric", "value", "unit"]


@dataclass(frozen=True)
class StudyFacts:
    """What a study was of: its axis, the scenes, and the methods."""

    name: str
    axis: str
    unit: str
    amounts: tuple[float, ...]
    cases: tuple[str, ...]
    methods: tuple[str, ...]
    track: bool = False
    seconds: float = SECONDS


@dataclass(frozen=True, eq=False)
class StudyResult:
    """What a study found; an amount whose job failed has no value.

    Attributes:
        results: of the suite that it is; `configuration["study"]` holds `StudyFacts`.
        curves: one per metric and method, of means over the cases.
    """

    results: Results
    curves: tuple[RobustnessCurve, ...]

    @classmethod
    def of(cls, results: Results) -> StudyResult:
        """The curves of a study's results."""
        about = facts_of(results)
        methods = [*about.methods, *map(method_on_own_poses, about.methods if about.track else ())]
        made = curves(values(results), about.amounts, methods, about.cases)
        return cls(results, tuple(made))

    @property
    def about(self) -> StudyFacts:
        """What it was of."""
        return facts_of(self.results)

    @property
    def failures(self) -> dict[str, str]:
        """The jobs that failed, with the reason."""
        return {job.name: job.failure for job in self.results.failures}

    @property
    def cpu_s(self) -> float:
        """Time of processors that all jobs took, whenever they were done, s."""
        return sum(job.cpu_seconds for job in self.results.jobs)

    def breaking(self) -> dict[str, float | None]:
        """Per method the amount at which it breaks."""
        return {
            curve.method: curve.breaking_amount()
            for curve in self.curves
            if curve.metric == METRICS[0]
        }


_FACTS = TypeAdapter(StudyFacts)


def facts_of(results: Results) -> StudyFacts:
    """What a study's results say of it."""
    return _FACTS.validate_python(results.configuration["study"])


def run_study(
    study: Study, methods: Sequence[str], cases: Sequence[str], seeds: Sequence[int], workers: Open,
    progress: Display, seconds: float = SECONDS, *, track: str | None = None,
) -> StudyResult:  # fmt: skip
    """Maps and scores every case, seed and amount, in sequences of so many seconds.

    Seeds are of the head motion, the sensor's noise and the perturbation. With `track`, a tracker's
    name, poses are found from the events, too; they, and maps on them, are scored.
    """
    suite = study_suite(study, methods, cases, seeds, seconds, track=track)
    results = run_suite(suite, ALL, workers, progress)
    about = StudyFacts(
        study.name, study.axis, study.unit, tuple(study.amounts), tuple(cases), tuple(methods),
        bool(track), seconds,
    )  # fmt: skip
    results.configuration["study"] = asdict(about)
    return StudyResult.of(results)


def study_suite(
    study: Study, methods: Sequence[str], cases: Sequence[str], seeds: Sequence[int],
    seconds: float = SECONDS, *, track: str | None = None,
) -> Suite:  # fmt: skip
    """The suite: a case for each scene and amount, with a window about the middle, where truth is.

    Raises:
        InputError: sequences too short for the windows.
    """
    if not seconds > 3 * MARGIN_S:
        raise InputError(f"seconds is {seconds:g}: a study needs more than {3 * MARGIN_S:g}")
    specs, mappers = {}, {}
    for amount in study.amounts:
        change = study.change(amount)
        window, mapper = window_of(change, seconds)
        mappers[f"at-{amount:g}"] = {"methods": list(methods), **mapper}
        for case in cases:
            specs[case_at(case, amount)] = CaseSpec(
                scene=case, seconds=seconds, windows=(window,), mappers=(f"at-{amount:g}",),
                sim=dict(change.sim), change=dict(change.scene),
                imperfection=dict(change.perturb) or None, track=track or False,
            )  # fmt: skip
    return Suite(
        name=study.name, summary=study.axis, seeds=tuple(seeds), spread_seeds=tuple(seeds),
        metrics=(*METRICS, *POSE_METRICS), mappers=mappers, cases=specs,
    )  # fmt: skip


def case_at(case: str, amount: float) -> str:
    """What the suite of a study calls a case at an amount."""
    return f"{case}.{amount:g}"


def window_of(change: Change, seconds: float) -> tuple[WindowSpec, dict[str, Any]]:
    """The window at an amount, about the middle of the sequence, and the mapper's settings."""
    mapper = dict(change.map)
    duration_s = round(mapper.pop("duration_s", seconds - 2 * MARGIN_S), 6)
    if duration_s > seconds:
        raise InputError(
            f"a window of {duration_s:g} s in sequences of {seconds:g} s: "
            "make them longer with --seconds"
        )
    start_s = round((seconds - duration_s) / 2, 6)
    return WindowSpec(start_s=start_s, duration_s=duration_s), mapper


def values(results: Results) -> pd.DataFrame:
    """The pooled numbers that are drawn, by scene and `amount` instead of the suite's cases."""
    about, rows = facts_of(results), results.rows
    points = {case_at(c, amount): (c, amount) for c in about.cases for amount in about.amounts}
    drawn = rows["metric"].isin((*METRICS, *POSE_METRICS)) & (rows["method"] != EVENTS)
    rows = rows[(rows["window"] == POOLED) & drawn]
    places = rows["case"].map(points)
    return rows.assign(
        case=places.str[0], amount=places.str[1].astype(float),
        method=rows["method"].str.replace(r" at-\S+$", "", regex=True),
    )  # fmt: skip


def write_study(folder: Path, result: StudyResult) -> list[Path]:
    """Writes NAME.png, NAME.svg, NAME.csv (every number drawn) and NAME.json (results).

    A kill leaves the study whole or without its NAME.json, which the next run replaces.
    """
    about = result.about
    names = file_names(study := study_named(about.name))
    check_files(folder, names, force=True)
    with files_together(folder, names, index=names[-1]) as staged:
        picture, drawing, numbers, whole = (staged / name for name in names)
        for path in (picture, drawing):
            draw(study, result.curves, path, sample_words(about.cases, result.results.seeds))
        write_csv(numbers, values(result.results)[_CSV_COLUMNS])
        whole.write_text(to_json(result.results), encoding="utf-8")
    return [folder / name for name in names]


def file_names(study: Study) -> tuple[str, ...]:
    """What a study writes: picture, drawing, numbers, and results."""
    return tuple(f"{study.name}{suffix}" for suffix in (".png", ".svg", ".csv", ".json"))
