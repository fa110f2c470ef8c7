"""Numbers that a gate compares: per case, method and metric, one value for each seed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict

from eventsweep.emvs.errors import InputError
from eventsweep.eval.scoring.metrics import Better
from eventsweep.eval.scoring.results import POOLED, Results, Row, Value, read_results
from eventsweep.eval.suite.results import FILE_NAME, Sample, SuiteResult, read_suite

SPEED_METHOD, SPEED_METRIC = "mapper", "cpu_time_ratio"


class Key(NamedTuple):
    """What a number is about."""

    case: str
    method: str
    metric: str

    def __str__(self) -> str:
        return f"{self.case} {self.method} {self.metric}"


class Series(BaseModel):
    """One metric of one method on one case.

    Attributes:
        identity: hash over what must be equal for two series to be comparable: the definition of
            the case, its scene, and what the metric means.
        values: by seed; by repetition where speed is measured.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    case: str
    method: str
    metric: str
    unit: str
    better: Better
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


@dataclass(frozen=True)
class Measured:
    """Everything of a result that can be compared.

    Attributes:
        name: of the suite or file.
        series: by what they are about.
        seeds: that were asked for.
        cases: that were asked for.
        failures: jobs that failed, with the reason.
        versions: of everything that shapes the numbers.
    """

    name: str
    series: Mapping[Key, Series]
    seeds: tuple[int, ...]
    cases: tuple[str, ...]
    failures: Mapping[str, str]
    versions: Mapping[str, str]


def read_measured(path: Path) -> Measured:
    """Reads a result: `suite.json`, or a `results.json` of any run.

    Raises:
        InputError: neither, or a damaged file.
    """
    if path.name == FILE_NAME or (path / FILE_NAME).is_file():
        return of_suite(read_suite(path))
    return of_results(read_results(path))


def of_suite(result: SuiteResult) -> Measured:
    """The pooled numbers of a suite's run, of the metrics that the suite names."""
    wanted = set(result.definition["metrics"])
    series: dict[Key, Series] = {}
    # Frozen sequences and such as were drawn anew are of different versions.
    frozen = [result.archive.version] if result.archive else []
    for sample in result.samples:
        scene = [result.cases[sample.case], sample.facts.scene, *frozen]
        for row in _pooled(sample.rows, wanted):
            identity = _hash([*scene, sample.facts.metrics.get(row.metric)])
            _add(series, row, sample.seed, identity)
    for case, ratios in result.speed.items():
        identity = _hash([result.cases[case], _scene_of(result.samples, case), SPEED_METRIC])
        for number, ratio in enumerate(ratios):
            row = Row(case, POOLED, SPEED_METHOD, SPEED_METRIC, ratio, "x", "lower")
            _add(series, row, number, identity)
    failures = {job.name: job.failure for job in result.failures}
    return Measured(
        result.suite, series, result.seeds, tuple(result.cases), failures, result.versions
    )


def of_results(results: Results) -> Measured:
    """The pooled numbers of any scored run: comparable on the same sequences, scored alike."""
    series: dict[Key, Series] = {}
    seed = results.seed or 0
    scored = results.configuration.get("score")
    for row in _pooled(results.rows, None):
        if math.isnan(row.value):  # as good as missing: gone, where the baseline has a number
            continue
        facts = [results.sequences.get(row.case), scored, row.metric, row.unit]
        # Own results may say nothing of what made their numbers; ours say it.
        version = results.metrics.get(row.metric)
        identity = _hash(facts if version is None else [*facts, version])
        _add(series, row, seed, identity)
    cases = tuple(dict.fromkeys(row.case for row in results.rows))
    return Measured("results", series, (seed,), cases, {}, results.versions)


def _pooled(rows: Iterable[Row], metrics: set[str] | None) -> Iterable[Row]:
    for row in rows:
        if row.window == POOLED and (metrics is None or row.metric in metrics):
            yield row


def _add(series: dict[Key, Series], row: Row, seed: int, identity: str) -> None:
    key = Key(row.case, row.method, row.metric)
    known = series.get(key)
    if known is None:
        known = Series(
            case=row.case, method=row.method, metric=row.metric, unit=row.unit,
            better=row.better, identity=identity, values={},
        )  # fmt: skip
    if known.identity != identity:
        raise InputError(f"{key}: seeds of different scenes or metrics: run the suite again")
    series[key] = known.model_copy(update={"values": {**known.values, seed: row.value}})


def _scene_of(samples: Sequence[Sample], case: str) -> str:
    return next((sample.facts.scene for sample in samples if sample.case == case), "")


def _hash(facts: Any) -> str:
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:12]
