"""Numbers that a gate compares: per case, method and metric, one value for each seed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import AliasChoices, Field

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.parameters import FrozenModel
from eventsweep.eval.results.direction import Direction
from eventsweep.eval.results.results import Results, Sample, read_results
from eventsweep.eval.results.table import POOLED, Value, each, tidy

if TYPE_CHECKING:
    import pandas as pd

SIGNED_ERRORS = ("bias", "bias_px", "bias_cells")
"""What a gate looks at whatever a suite's definition names: a shift makes some depths better."""
SPEED_METHOD, SPEED_METRIC = "mapper", "cpu_time_ratio"
PROCESSOR, ON = "processor", " on "  # among versions: what the speed was measured on


class Key(NamedTuple):
    """What a number is about."""

    case: str
    method: str
    metric: str

    def __str__(self) -> str:
        return f"{self.case} {self.method} {self.metric}"


class Origin(FrozenModel):
    """What the numbers of a case with one seed were made of, as hashes; empty where unknown.

    Attributes:
        sequence: over the files of the sequence that was mapped.
        recipe: over what that was made from: scene, settings and the simulator's code.
    """

    sequence: str = ""
    recipe: str = ""


class Series(FrozenModel):
    """One metric of one method on one case.

    Attributes:
        identity: hash over what must be equal for two series to be comparable: the definition of
            the case, its scene, and what the metric means.
        values: by seed; by repetition where speed is measured.
        origins: by seed; a baseline keeps them by case.
    """

    case: str
    method: str
    metric: str
    unit: str
    direction: Direction = Field(validation_alias=AliasChoices("direction", "better"))
    identity: str
    values: dict[int, Value]
    origins: dict[int, Origin] = Field(default_factory=dict, exclude=True)

    @property
    def key(self) -> Key:
        """What it is about."""
        return Key(self.case, self.method, self.metric)

    @property
    def mean(self) -> float:
        """Over all seeds; NaN where there is none."""
        values = list(self.values.values())
        return sum(values) / len(values) if values else math.nan

    @property
    def spread(self) -> float:
        """Standard deviation over all seeds; NaN of fewer than two."""
        values, mean = list(self.values.values()), self.mean
        if len(values) < 2:
            return math.nan
        return math.sqrt(sum((value - mean) ** 2 for value in values) / (len(values) - 1))


def means_over_seeds(series: Iterable[Series]) -> pd.DataFrame:
    """A table with the mean of each series as the number of all windows."""
    return tidy(_about(numbers) | {"value": numbers.mean} for numbers in series)


def rows_of_seeds(series: Iterable[Series]) -> pd.DataFrame:
    """A table with each seed's value of each series as the number of all windows."""
    return tidy(
        _about(numbers) | {"seed": seed, "value": value}
        for numbers in series
        for seed, value in numbers.values.items()
    )


def _about(numbers: Series) -> dict[str, Any]:
    names = ("case", "method", "metric", "unit", "direction")
    return {name: getattr(numbers, name) for name in names} | {"window": POOLED}


@dataclass(frozen=True)
class Measured:
    """Everything of a result that can be compared; its seeds and cases were asked for."""

    name: str
    series: Mapping[Key, Series]
    seeds: tuple[int, ...]
    cases: tuple[str, ...]
    failures: Mapping[str, str]
    versions: Mapping[str, str]


def read_measured(path: Path) -> Measured:
    """Reads the numbers of a run or suite."""
    return read_results(path, measured_of)


def measured_of(results: Results) -> Measured:
    """The pooled numbers: of a suite, of the metrics that it names."""
    rows = results.rows[results.rows["window"] == POOLED]
    if results.suite:
        signed = rows["metric"].isin(SIGNED_ERRORS) & rows["value"].notna()
        rows = rows[rows["metric"].isin(results.definition["metrics"]) | signed]
    else:
        # What is undefined is as good as missing: gone, where the baseline has a number.
        rows = rows[rows["value"].notna()].fillna({"seed": results.seed or 0})
    return Measured(
        results.suite or "results",
        {numbers.key: numbers for numbers in (*_series(rows, results), *_speed(results))},
        results.seeds or (results.seed or 0,),
        results.case_names,
        {job.name: job.failure for job in results.failures},
        results.versions,
    )


def _series(rows: pd.DataFrame, results: Results) -> Iterable[Series]:
    """The rows by what they are about, with one value for each seed."""
    samples = {(sample.case, sample.seed): sample for sample in results.samples}
    origins = _origins(results)
    seedless = {sample.case: sample for sample in reversed(results.samples)}
    for about, seeds in rows.groupby(list(Key._fields), sort=False):
        key = Key(*map(str, about))
        identities = {
            _identity(results, samples.get((row.case, row.seed), seedless[row.case]), row)
            for row in each(seeds)
        }
        if len(identities) > 1:
            raise InputError(f"{key}: seeds of different scenes or metrics: run the suite again")
        yield Series(
            **key._asdict(), unit=seeds["unit"].iloc[0], direction=seeds["direction"].iloc[0],
            identity=identities.pop(), values=dict(zip(seeds["seed"], seeds["value"], strict=True)),
            origins=origins.get(key.case, {}),
        )  # fmt: skip


def _origins(results: Results) -> dict[str, dict[int, Origin]]:
    """What every case and seed was made of."""
    origins: dict[str, dict[int, Origin]] = {}
    for sample in results.samples:
        seed = sample.seed if sample.seed is not None else results.seed or 0
        origin = Origin(sequence=sample.sequence, recipe=_recipe(results, sample))
        origins.setdefault(sample.case, {})[seed] = origin
    return origins


def _recipe(results: Results, sample: Sample) -> str:
    """What the sequence was made from; empty where it was found, or nobody says by which code."""
    if not results.suite:
        return _hash([sample.sim, sample.seed]) if sample.sim else ""
    code = "" if results.archive else results.code.get("simulate", "")
    return _hash([results.cases.get(sample.case), sample.scene, sample.seed, code]) if code else ""


def _identity(results: Results, sample: Sample, row: Any) -> str:
    """What must be equal: a suite's definition and scene; of a run its sequence and scoring."""
    version = sample.metrics.get(row.metric)
    if results.suite:
        # Frozen sequences and such as were drawn anew are of different versions.
        archive = [results.archive.version] if results.archive else []
        # Which pixels these are of, predictions decide with.
        theirs = [results.predictions] if row.region in ("common", "equal") else []
        beside = theirs if results.predictions else []
        return _hash([results.cases[row.case], sample.scene, *archive, version, *beside])
    facts = [sample.sequence or None, results.configuration.get("score"), row.metric, row.unit]
    # Own results may say nothing of what made their numbers; ours say it.
    return _hash(facts if version is None else [*facts, version])


def _speed(results: Results) -> Iterable[Series]:
    scenes = {sample.case: sample.scene for sample in reversed(results.samples)}
    where = results.versions.get(PROCESSOR, "an unnamed processor")
    for case, ratios in results.speed.items():
        yield Series(
            case=case, method=SPEED_METHOD, metric=SPEED_METRIC, unit="x", direction="lower",
            identity=ON.join(
                [_hash([results.cases[case], scenes.get(case, ""), SPEED_METRIC]), where]
            ),
            values=dict(enumerate(ratios)),
        )  # fmt: skip


def _hash(facts: Any) -> str:
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:12]
