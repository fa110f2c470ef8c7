"""What a gate holds results against: a file that says who measured it, with what, and why."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from functools import reduce
from pathlib import Path
from typing import Annotated

from pydantic import Field

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.parameters import FrozenModel
from eventsweep.emvs.utils.files import write_text
from eventsweep.eval.results.files import json_text, read_json
from eventsweep.eval.results.series import SPEED_METRIC, Key, Measured, Origin, Series

SCHEMA_VERSION = 3
_CURE = "restore it, or move it away and write another by `eventsweep gate --update --reason ...`"


class BaselineChange(FrozenModel):
    """Why a baseline was written, and when (UTC)."""

    date: str
    reason: str


class Baseline(FrozenModel):
    """A baseline: series, the seeds they were measured with, and why it was written.

    `origins` are by case and seed; versions 1 and 2 of this layout had none.
    """

    schema_version: int = SCHEMA_VERSION
    name: str
    seeds: tuple[int, ...]
    history: tuple[BaselineChange, ...]
    versions: dict[str, str]
    origins: dict[str, dict[int, Origin]] = Field(default_factory=dict)
    series: Annotated[tuple[Series, ...], Field(min_length=1)]

    def by_key(self) -> Mapping[Key, Series]:
        """The series, by what they are about."""
        return {
            numbers.key: numbers.model_copy(update={"origins": self.origins.get(numbers.case, {})})
            for numbers in self.series
        }


def together(parts: Iterable[Measured]) -> Measured:
    """Several results as one.

    Raises:
        InputError: two results of the same case, or of other seeds.
    """
    return reduce(_joined, parts)


def _joined(one: Measured, other: Measured) -> Measured:
    if both := sorted({*one.cases} & {*other.cases}):
        raise InputError(f"two results of case {both[0]}: name one result for each case")
    if one.seeds != other.seeds:
        raise InputError(
            f"results of seeds {list(one.seeds)} and {list(other.seeds)}: needs results of the "
            "same seeds; keep a baseline for each"
        )
    return Measured(
        one.name if one.name == other.name else f"{one.name}, {other.name}",
        {**one.series, **other.series},
        one.seeds,
        (*one.cases, *other.cases),
        {**one.failures, **other.failures},
        {**one.versions, **other.versions},
    )


def make_baseline(measured: Measured, reason: str, before: Baseline | None) -> Baseline:
    """A result as a baseline; the history of the one that it replaces goes on.

    Called again on the same day for the same reason, as after a kill, it adds nothing to it.

    Raises:
        InputError: no reason, failed jobs, or undefined numbers.
    """
    if not reason.strip():
        raise InputError("a new baseline needs --reason: why may the numbers change?")
    if measured.failures:
        name, why = next(iter(measured.failures.items()))
        raise InputError(f"a run with failed jobs cannot become a baseline: {name}: {why}")
    undefined = [
        numbers.key for numbers in measured.series.values() if not _whole(numbers, measured)
    ]
    if undefined or not measured.series:
        what = f"{undefined[0]} is undefined or lacks seeds" if undefined else "there is no number"
        raise InputError(f"an incomplete result cannot become a baseline: {what}")
    history = before.history if before else ()
    now = BaselineChange(date=datetime.now(UTC).date().isoformat(), reason=" ".join(reason.split()))
    return Baseline(
        name=measured.name,
        seeds=measured.seeds,
        history=history if now in history[-1:] else (*history, now),
        versions=dict(measured.versions),
        origins={one.case: one.origins for one in measured.series.values() if one.origins},
        series=tuple(sorted(measured.series.values(), key=lambda numbers: numbers.key)),
    )


def _whole(numbers: Series, measured: Measured) -> bool:
    seeds = set(numbers.values)
    return all(map(math.isfinite, numbers.values.values())) and (
        seeds >= set(measured.seeds) or numbers.metric == SPEED_METRIC
    )


def write_baseline(path: Path, baseline: Baseline) -> None:
    """Writes the file atomically, one series a line, so that a change shows in a diff.

    Values keep seven digits, far more than any tolerance.
    """
    content = baseline.model_dump(mode="json")
    for series in content["series"]:
        values = series["values"].items()
        series["values"] = {seed: float(f"{value:.7g}") for seed, value in values}
    write_text(path, json_text(content, "series", indent=1))


def read_baseline(path: Path) -> Baseline:
    """Reads a baseline."""
    return read_json(
        path, Baseline.model_validate, (1, 2, SCHEMA_VERSION), _CURE, f"baseline {path}"
    )
