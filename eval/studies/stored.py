"""Studies on disk: results with a study among their settings, or the curves of earlier versions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.inputs import TABLE_BYTES, parse_json, read_text
from eventsweep.eval.results.files import read_json
from eventsweep.eval.results.results import JobNote, Results, results_from
from eventsweep.eval.studies.curves import RobustnessCurve
from eventsweep.eval.studies.run import StudyResult

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


def _study(content: dict[str, Any]) -> StudyResult:
    if "schema_version" in content:
        return StudyResult.of(results_from(content))
    amounts = content["amounts"]
    curves = tuple(_curve(curve, amounts) for curve in content["curves"])
    names = ("axis", "unit", "amounts", "cases")
    about = {"name": content["study"], **{name: content[name] for name in names}}
    about |= {"methods": list(content["breaks_at"]), "track": False}
    failures = tuple(JobNote(name, failure=why) for name, why in content["failures"].items())
    return StudyResult(
        Results(
            pd.DataFrame(), {"study": about}, versions=content["versions"], suite=content["study"],
            seeds=tuple(content["seeds"]), jobs=failures,
        ),
        curves,
    )  # fmt: skip


def _curve(stored: dict[str, Any], amounts: list[float]) -> RobustnessCurve:
    mean, low, high = (np.array(stored[name], np.float64) for name in ("mean", "low", "high"))
    for end in (mean, low, high):
        if len(end) != len(amounts):
            raise InputError(
                f"{stored['method']} {stored['metric']} has {len(end)} values for {len(amounts)} "
                "amounts"
            )
    samples = np.array(stored.get("samples", [0] * len(amounts)))
    return RobustnessCurve(
        stored["method"], stored["metric"], stored["unit"], tuple(amounts), mean, low, high, samples
    )
