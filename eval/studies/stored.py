"""Studies on disk: results with a study among their settings, or the curves of earlier versions."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.inputs import TABLE_BYTES, parse_json, read_text
from eventsweep.eval.results.files import read_json
from eventsweep.eval.results.results import JobNote, Results, results_from
from eventsweep.eval.results.table import Value, tidy
from eventsweep.eval.studies.curves import RobustnessCurve
from eventsweep.eval.studies.run import StudyFacts, StudyResult

_AGAIN = "run the study again"


def find_studies(folder: Path) -> list[Path]:
    """The studies' JSON files in a folder."""
    return [path for path in sorted(folder.glob("*.json")) if _is_study(path)]


def _is_study(path: Path) -> bool:
    try:
        content = parse_json(read_text(path, TABLE_BYTES))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and (
        {"study", "breaks_at"} <= content.keys() or "study" in (content.get("configuration") or {})
    )


def read_study(path: Path) -> StudyResult:
    """Reads a study's JSON file.

    Raises:
        InputError: a file that is damaged or of another version.
    """
    return read_json(path, _study, (), _AGAIN)


class _OldCurve(BaseModel):
    method: str
    metric: str
    unit: str
    mean: tuple[Value, ...]
    low: tuple[Value, ...]
    high: tuple[Value, ...]


class _OldStudy(BaseModel):
    """What earlier versions wrote; what is not needed is not looked at."""

    study: str
    axis: str
    unit: str
    cases: tuple[str, ...]
    seeds: tuple[int, ...]
    amounts: tuple[float, ...]
    breaks_at: dict[str, float | None]
    curves: tuple[_OldCurve, ...]
    failures: dict[str, str]
    versions: dict[str, str]


def _study(content: dict[str, Any]) -> StudyResult:
    if "schema_version" in content:
        return StudyResult.of(results_from(content))
    old = _OldStudy.model_validate(content)
    about = StudyFacts(old.study, old.axis, old.unit, old.amounts, old.cases, tuple(old.breaks_at))
    failures = tuple(JobNote(name, failure=why) for name, why in old.failures.items())
    results = Results(
        tidy(()), {"study": asdict(about)}, versions=old.versions, suite=old.study, seeds=old.seeds,
        jobs=failures,
    )  # fmt: skip
    return StudyResult(results, tuple(_curve(curve, old.amounts) for curve in old.curves))


def _curve(old: _OldCurve, amounts: tuple[float, ...]) -> RobustnessCurve:
    mean, low, high = (np.array(values) for values in (old.mean, old.low, old.high))
    if any(len(end) != len(amounts) for end in (mean, low, high)):
        raise InputError(
            f"{old.method} {old.metric} has {len(old.mean)} values for {len(amounts)} amounts"
        )
    samples = np.isfinite(mean).astype(np.int64)
    return RobustnessCurve(old.method, old.metric, old.unit, amounts, mean, low, high, samples)
