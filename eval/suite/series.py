"""Numbers that a gate compares: per case, method and metric, one value for each seed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import AliasChoices, Field

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.parameters import FrozenModel
from eventsweep.eval.scoring.direction import Direction
from eventsweep.eval.scoring.results import POOLED, Results, Value, each, read_results, tidy
from eventsweep.eval.suite.results import FILE_NAME, SuiteResult, read_suite

if TYPE_CHECKING:
    import pandas as pd

SPEED_METHOD, SPEED_METRIC = "mapper", "cpu_time_ratio"


class Key(NamedTuple):
    """What a number is about."""

    case: str
    method: str
    metric: str

    def __str__(self) -> str:
        return f"{self.case} {self.method} {self.metric}"


class Series(FrozenModel):
    """One metric of one method on one case.

    Attributes:
        identity: hash over what must be equal for two series to be comparable: the definition of
            the case, its scene, and what the metric means.
        values: by seed; by repetition where speed is measured.
    """

    case: str
    method: str
    metric: str
    unit: str
    direction: Direction = Field(validation_alias=AliasChoices("direction", "better"))
    identity: str
    values: dict[int, Value]

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
    names = ("case", "method", "metric", "unit", "direction")
    return tidy(
        {name: getattr(one, name) for name in names} | {"window": POOLED, "value": one.mean}
        for one in series
    )


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
    """Reads a result: `suite.json`, or a `results.json` of any run."""
    if path.name == FILE_NAME or (path / FILE_NAME).is_file():
        return read_suite(path, of_suite)
    return of_results(read_results(path))


def of_suite(result: SuiteResult) -> Measured:
    """The pooled numbers of a suite's run, of the metrics that the suite names."""
    facts = {(sample.case, sample.seed): sample.facts for sample in result.samples}
    scenes = {sample.case: sample.facts.scene for sample in reversed(result.samples)}
    # Frozen sequences and such as were drawn anew are of different versions.
    archive = [result.archive.version] if result.archive else []

    def identity(row: Any) -> str:
        of_sample = facts[row.case, row.seed]
        version = of_sample.metrics.get(row.metric)
        return _hash([result.cases[row.case], of_sample.scene, *archive, version])

    series = _series(_pooled(result.rows, result.definition["metrics"]), identity)
    for case, ratios in result.speed.items():
        one = Series(
            case=case, method=SPEED_METHOD, metric=SPEED_METRIC, unit="x", direction="lower",
            identity=_hash([result.cases[case], scenes.get(case, ""), SPEED_METRIC]),
            values=dict(enumerate(ratios)),
        )  # fmt: skip
        series[one.key] = one
    failures = {job.name: job.failure for job in result.failures}
    return Measured(
        result.suite, series, result.seeds, tuple(result.cases), failures, result.versions
    )


def of_results(results: Results) -> Measured:
    """The pooled numbers of any scored run: comparable on the same sequences, scored alike."""
    scored = results.configuration.get("score")

    def identity(row: Any) -> str:
        facts = [results.sequences.get(row.case), scored, row.metric, row.unit]
        # Own results may say nothing of what made their numbers; ours say it.
        version = results.metrics.get(row.metric)
        return _hash(facts if version is None else [*facts, version])

    seed = results.seed or 0
    pooled = _pooled(results.rows).fillna({"seed": seed})
    # What is undefined is as good as missing: gone, where the baseline has a number.
    series = _series(pooled[pooled["value"].notna()], identity)
    cases = tuple(results.rows["case"].unique())
    return Measured("results", series, (seed,), cases, {}, results.versions)


def _pooled(rows: pd.DataFrame, metrics: Collection[str] | None = None) -> pd.DataFrame:
    pooled = rows[rows["window"] == POOLED]
    return pooled if metrics is None else pooled[pooled["metric"].isin(metrics)]


def _series(rows: pd.DataFrame, identity: Callable[[Any], str]) -> dict[Key, Series]:
    """The rows by what they are about, with one value for each seed."""
    series: dict[Key, Series] = {}
    for about, of_seeds in rows.groupby(list(Key._fields), sort=False):
        key, identities = Key(*map(str, about)), set(map(identity, each(of_seeds)))
        if len(identities) > 1:
            raise InputError(f"{key}: seeds of different scenes or metrics: run the suite again")
        series[key] = Series(
            **key._asdict(), unit=of_seeds["unit"].iloc[0],
            direction=of_seeds["direction"].iloc[0], identity=identities.pop(),
            values=dict(zip(of_seeds["seed"], of_seeds["value"], strict=True)),
        )  # fmt: skip
    return series


def _hash(facts: Any) -> str:
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:12]
