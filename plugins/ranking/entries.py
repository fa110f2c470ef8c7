"""Results as a ranking needs them: small enough to be kept for ever, one entry for each run.

An entry holds the pooled numbers of a suite's run, without windows. Entries of the same sequences
are joined, and such whose sequences another graphics library rendered from the same definition:
their numbers agree within a measured bound. Those of other sequences are not comparable.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import Field, model_validator

from eventsweep.emvs.parameters import FrozenModel
from eventsweep.emvs.utils.inputs import file_in
from eventsweep.eval.results.direction import Direction
from eventsweep.eval.results.files import read_json
from eventsweep.eval.results.results import (
    DEFAULT_MAPPER,
    ArchiveFacts,
    MeasuredCost,
    Results,
    Sample,
    shown_name,
)
from eventsweep.eval.results.table import EVENTS, POOLED, Value, each, together
from eventsweep.eval.scoring.method_scores import BAD_POINTS, CAUSE_PREFIX
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.suite.predictions import perfect_scores
from eventsweep.plugins.ranking.facts import SubmissionFacts
from eventsweep.plugins.ranking.tracks import OTHERS, SEMI_DENSE

if TYPE_CHECKING:
    import pandas as pd

DATA_NAME = "ranking.json"
RANKED_BY = "mean_error"
"""The metric by which methods are placed."""
SCHEMA_VERSION = 1
COVERAGES = (1, 2, 5, 10, 20)
METRICS = (
    "points", "completeness", "mean_error", "median_error", "rmse", "abs_rel", "bad_published",
    "outlier_share", "delta_1", "f1_5cm", "aurc", BAD_POINTS,
    *(f"mean_error_top_{share}pct" for share in COVERAGES),
    *(f"{CAUSE_PREFIX}{cause}" for cause in CAUSES),
)  # fmt: skip
POSE_METRICS = (
    "ate_share", "ate_rmse", "ate_rotation_rmse", "drift", "drift_rotation", "scale_error",
    "time_covered",
)  # fmt: skip
"""Metrics of poses that were found from events, where a case asks for them."""
RENDERERS_DIFFER_PERCENT = 2.0
"""Largest change of a method's mean error between graphics libraries, by the table in the page
`ranking`, by `python tests/benchmarks renderers` of commit 77cd9c78."""
_DIGITS = 6
# What decides a sequence beside its definition, its seed and the graphics library.
_RENDERED_BY = ("eventsweep", "mujoco", "numpy")


class Unit(NamedTuple):
    """What was drawn independently: one case with one seed."""

    case: str
    seed: int


class RankedCase(FrozenModel):
    """A case of an entry.

    Attributes:
        scene: its name.
        conditions: what is hard about it.
        ranked: whether methods are ranked by it: those that only test the program are not.
        sequences: hash of the sequence of each of the entry's seeds; empty where it failed.
        rendered_from: hash of what each was rendered from: scene, settings and versions, but not
            the graphics library; empty where that is not known.
    """

    scene: str
    conditions: tuple[str, ...] = ()
    ranked: bool = True
    sequences: tuple[str, ...]
    rendered_from: tuple[str, ...] = ()


class RankingEntry(FrozenModel):
    """One run.

    Attributes:
        label: what people call it, such as a version.
        track: which one it enters: `semi-dense`, or one of `tracks.OTHERS`.
        suite: name of the suite.
        digest: hash of its definition.
        archive: whose sequences were used; None where they were drawn anew.
        seeds: of the run.
        cases: by name.
        units: per metric, its unit and direction.
        versions_of_metrics: per metric, the hash of what it computes.
        values: per method, metric and case one value for each seed.
        poses: per tracker, metric and case one value for each seed.
        stated: per method of others, what its submitter says.
        cost: per method, what was measured here.
        perfect: per method, where it has a perfect score.
        digests: per method of others, the hash over its depth maps and what their numbers mean.
        settings: per method of ours, what its mapper sets apart from the defaults.
        code: per stage, the version of its code.
        versions: of everything that shapes numbers.
        platform: of the machine that collected them.
        failures: jobs that failed, with the reason.
    """

    label: str
    track: str = SEMI_DENSE
    suite: str
    digest: str
    archive: ArchiveFacts | None = None
    seeds: tuple[int, ...]
    cases: dict[str, RankedCase]
    units: dict[str, tuple[str, Direction]]
    versions_of_metrics: dict[str, str]
    values: dict[str, dict[str, dict[str, tuple[Value, ...]]]]
    poses: dict[str, dict[str, dict[str, tuple[Value, ...]]]] = Field(default_factory=dict)
    stated: dict[str, SubmissionFacts] = Field(default_factory=dict)
    cost: dict[str, MeasuredCost] = Field(default_factory=dict)
    perfect: dict[str, list[str]] = Field(default_factory=dict)
    digests: dict[str, str] = Field(default_factory=dict)
    settings: dict[str, dict[str, Any]] = Field(default_factory=dict)
    code: dict[str, str] = Field(default_factory=dict)
    versions: dict[str, str] = Field(default_factory=dict)
    platform: str = ""
    failures: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _of_every_seed(self) -> RankingEntry:
        """One number and one sequence for each seed, numbers of known cases, no infinite ones."""
        if self.track not in (SEMI_DENSE, *OTHERS):
            raise ValueError(f"track: {self.track} is not known")
        ranked_by = OTHERS[self.track].ranked_by if self.track in OTHERS else RANKED_BY
        if self.values and ranked_by not in self.units:
            raise ValueError(f"units: {ranked_by} is missing")
        for case, ranked in self.cases.items():
            if len(ranked.sequences) != len(self.seeds):
                raise ValueError(f"cases.{case}: {len(ranked.sequences)} sequences")
        for method, metrics in (*self.values.items(), *self.poses.items()):
            for place, found in chain.from_iterable(cases.items() for cases in metrics.values()):
                if len(found) != len(self.seeds) or any(map(math.isinf, found)):
                    raise ValueError(f"values.{method}: {place} needs a number for each seed")
        return self

    @property
    def part(self) -> str:
        """`public` or `hidden`."""
        return "hidden" if self.archive and self.archive.part == "hidden" else "public"

    def value(self, method: str, metric: str, unit: Unit) -> float:
        """A number; NaN where there is none."""
        found = self.values.get(method, {}).get(metric, {}).get(unit.case)
        if found is None or unit.seed not in self.seeds:
            return math.nan
        return found[self.seeds.index(unit.seed)]

    def has(self, method: str, case: str) -> bool:
        """Whether a method was run on a case."""
        return any(case in cases for cases in self.values.get(method, {}).values())

    def sequence(self, unit: Unit) -> str:
        """The hash of a sequence; empty where there is none."""
        return self._hash(unit, "sequences")

    def rendered_from(self, unit: Unit) -> str:
        """The hash of what a sequence was rendered from; empty where that is not known."""
        return self._hash(unit, "rendered_from")

    def _hash(self, unit: Unit, name: str) -> str:
        hashes = getattr(self.cases.get(unit.case), name, ())
        known = dict(zip(self.seeds, hashes, strict=False))
        return str(known.get(unit.seed, ""))


class RankingData(FrozenModel):
    """`ranking.json`: everything that a page shows but for its pictures."""

    schema_version: int = SCHEMA_VERSION
    ranked_by: str = RANKED_BY
    entries: tuple[RankingEntry, ...] = Field(min_length=1)

    def to_text(self) -> str:
        """As JSON; a suite's entries as before there were other tracks."""
        content = self.model_dump(mode="json")
        for entry in content["entries"]:
            if entry["track"] == SEMI_DENSE:
                del entry["track"]
        return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def entry_of(result: Results, label: str) -> RankingEntry:
    """A suite's run in small."""
    mappers = result.definition["mappers"]
    rows = result.rows
    rows = rows[(rows["window"] == POOLED) & (rows["method"] != EVENTS)]
    depth, poses = rows[rows["metric"].isin(METRICS)], rows[rows["metric"].isin(POSE_METRICS)]
    names = {method: shown_name(method, mappers) for method in dict.fromkeys(rows["method"])}
    values = by_method(depth.assign(method=depth["method"].map(names)), result.seeds)
    perfect = perfect_scores(result.rows)
    return RankingEntry(
        label=label,
        suite=result.suite,
        digest=result.digest,
        archive=result.archive,
        seeds=result.seeds,
        cases={case: _case(result, case) for case in result.cases},
        units={r.metric: (r.unit, r.direction) for r in each(together([depth, poses]))},
        versions_of_metrics=_metric_versions(result),
        values=values,
        poses=by_method(poses, result.seeds),
        stated={n: SubmissionFacts.model_validate(one) for n, one in result.stated.items()},
        cost={shown_name(name, mappers): one for name, one in result.cost.items()},
        perfect={shown_name(name, mappers): where for name, where in perfect.items()},
        digests=dict(result.predictions),
        settings={
            shown_name(name, mappers): settings_of(name, mappers)
            for name in dict.fromkeys(rows["method"])
            if shown_name(name, mappers) in values and name not in result.predictions
        },
        code=result.code,
        versions=result.versions,
        platform=result.platform,
        failures={job.name: job.failure for job in result.failures},
    )


def by_method(
    rows: pd.DataFrame, seeds: Sequence[int]
) -> dict[str, dict[str, dict[str, tuple[float, ...]]]]:
    """Per method, metric and case one value for each seed; NaN where there is none."""
    found: dict[str, dict[str, dict[str, tuple[float, ...]]]] = {}
    for _, some in rows.groupby(["method", "metric", "case"], sort=False):
        known = {row.seed: float(f"{row.value:.{_DIGITS}g}") for row in each(some)}
        first = next(each(some))
        values = tuple(known.get(seed, math.nan) for seed in seeds)
        found.setdefault(first.method, {}).setdefault(first.metric, {})[first.case] = values
    return found


def settings_of(method: str, mappers: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """What the mapper of a method's rows sets, but for its list of methods."""
    _, _, mapper = method.partition(" ")
    own = mappers.get(mapper or DEFAULT_MAPPER, {})
    return {name: value for name, value in own.items() if name != "methods"}


def is_ranked(definition: Mapping[str, Any], case: str) -> bool:
    """Whether methods are placed by a case of a suite: not by one that few of them map.

    Cases of scores that no suite made always count.
    """
    spec = definition.get("cases", {}).get(case)
    return spec is None or DEFAULT_MAPPER in spec["mappers"]


def _case(result: Results, case: str) -> RankedCase:
    spec = result.definition["cases"][case]
    facts = {s.seed: s for s in result.samples if s.case == case}
    return RankedCase(
        scene=Path(spec["scene"]).name,  # of a model or a given sequence, not where it lies
        conditions=tuple(spec.get("conditions", ())),
        ranked=is_ranked(result.definition, case),
        sequences=tuple(facts[s].sequence if s in facts else "" for s in result.seeds),
        rendered_from=tuple(_rendered_from(facts[s]) if s in facts else "" for s in result.seeds),
    )


def _rendered_from(sample: Sample) -> str:
    versions = {name: sample.versions.get(name, "") for name in _RENDERED_BY}
    content = json.dumps([sample.scene, sample.sim, versions], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def _metric_versions(result: Results) -> dict[str, str]:
    known = result.samples[0].metrics if result.samples else {}
    return {name: version for name, version in known.items() if name in (*METRICS, *POSE_METRICS)}


def read_data(path: Path) -> RankingData:
    """Reads `ranking.json`, given the file or its folder."""
    file = file_in(path, DATA_NAME)
    return read_json(file, RankingData.model_validate, (SCHEMA_VERSION,), "make the ranking again")


class Merged(NamedTuple):
    """Entries of the same sequences as one table.

    Attributes:
        cases: by which methods are ranked, in order.
        seeds: per case, those of the newest entry.
        owner: per method, the newest entry that has it.
        refused: entries that are not comparable, and why.
        base: the newest entry, whose sequences count.
        redrawn: labels of entries whose sequences another graphics library rendered.
    """

    cases: tuple[str, ...]
    seeds: Mapping[str, tuple[int, ...]]
    owner: Mapping[str, RankingEntry]
    refused: tuple[tuple[str, str], ...]
    base: RankingEntry
    redrawn: tuple[str, ...] = ()

    def units(self, case: str) -> list[Unit]:
        """The units of a case."""
        return [Unit(case, seed) for seed in self.seeds[case]]

    def of_case(self, method: str, metric: str, case: str) -> list[float]:
        """A method's values of a case, one for each seed."""
        return [self.owner[method].value(method, metric, unit) for unit in self.units(case)]

    def lacks(self, method: str) -> list[str]:
        """The cases on which a method was not run with every seed: its result may have fewer."""
        entry = self.owner[method]
        return [
            case
            for case in self.cases
            if not (entry.has(method, case) and all(map(entry.sequence, self.units(case))))
        ]

    def complete(self) -> list[str]:
        """Methods that were run on every case with every seed."""
        return [method for method in self.owner if not self.lacks(method)]


def join(entries: Sequence[RankingEntry]) -> Merged:
    """Joins entries of one part that have the newest one's sequences; of each method the newest.

    Args:
        entries: oldest first, one or more.
    """
    base = entries[-1]
    seeds = {
        case: tuple(seed for seed in base.seeds if base.sequence(Unit(case, seed)))
        for case in base.cases
    }
    cases = tuple(case for case, found in seeds.items() if found and base.cases[case].ranked)
    owner: dict[str, RankingEntry] = {}
    refused, redrawn = [], []
    units = [Unit(case, seed) for case in cases for seed in seeds[case]]
    for entry in entries:
        why = why_not(base, entry, units)
        if why:
            refused.append((entry.label, why))
            continue
        owner |= dict.fromkeys(entry.values, entry)
        if _differing(base, entry, units):
            redrawn.append(entry.label)
    return Merged(cases, seeds, owner, tuple(refused), base, tuple(redrawn))


def why_not(base: RankingEntry, entry: RankingEntry, units: Sequence[Unit]) -> str:
    """Why an entry's numbers do not stand beside those of another; empty where they do."""
    if entry is base:
        return ""
    if not any(map(entry.sequence, units)):
        return f"no case and seed in common with {base.label}"
    for unit in _differing(base, entry, units):
        source = entry.rendered_from(unit)
        if not source or source != base.rendered_from(unit):
            return f"not comparable, other sequences: {_source(entry)} against {_source(base)}"
    other = _other_metrics(base, entry)
    return f"not comparable, these metrics compute something else: {', '.join(other)}" * bool(other)


def _differing(base: RankingEntry, entry: RankingEntry, units: Sequence[Unit]) -> list[Unit]:
    """Of what both have, the sequences that differ."""
    both = [unit for unit in units if entry.sequence(unit)]
    return [unit for unit in both if entry.sequence(unit) != base.sequence(unit)]


def _other_metrics(base: RankingEntry, entry: RankingEntry) -> list[str]:
    mine, theirs = base.versions_of_metrics, entry.versions_of_metrics
    return sorted(name for name in mine.keys() & theirs.keys() if mine[name] != theirs[name])


def _source(entry: RankingEntry) -> str:
    return f"archive {entry.archive.version}" if entry.archive else "drawn anew"


def finite_mean(values: Iterable[float]) -> float:
    """The mean; NaN where one is undefined or there is none."""
    found = list(values)
    return sum(found) / len(found) if found else math.nan
