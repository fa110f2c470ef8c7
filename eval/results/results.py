"""Results: a table of scores and what made it, in memory and as `results.json` or `suite.json`.

A run, a folder that was scored, a suite and a study say the same: the numbers, where each case's
data came from, the settings, and the outcome of the jobs that did the work.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar, overload

from pydantic import ConfigDict, Field, TypeAdapter

from eventsweep.emvs.errors import InputError, check_path
from eventsweep.emvs.utils.files import write_text
from eventsweep.emvs.utils.inputs import file_in
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.results.files import json_text, read_json
from eventsweep.eval.results.table import EVENTS, RIG, Rows, tidy, together, unit_fault, write_csv

if TYPE_CHECKING:
    import pandas as pd

SCHEMA_VERSION = 3
JSON_NAME, CSV_NAME = "results.json", "results.csv"
SUITE_NAME, SUITE_CSV, PICTURES_FOLDER = "suite.json", "suite.csv", "pictures"
DEFAULT_MAPPER = "default"
Made = TypeVar("Made")
_COLUMNS_OF_1 = {"better": "direction", "points": "support"}
_STRICT = ConfigDict(extra="forbid")
_Amount = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class Sample:
    """One case with one seed, and where its numbers came from; empty where that is not known.

    Attributes:
        seed: of motion and noise; None where nothing was simulated.
        sequence: hash over the files of the sequence.
        events: hash of camera 0's events.
        truth: hash of camera 0's ground truth.
        scene: hash over what defines the scene.
        renderer: the graphics library that drew it.
        sim: settings of the simulator.
        versions: of the programs that simulated it.
        metrics: per metric, the hash of what it makes of fixed maps.
        windows: per window begin, end and reference time, µs.
    """

    case: str
    seed: int | None = None
    sequence: str = ""
    events: str = ""
    truth: str = ""
    scene: str = ""
    renderer: str = ""
    sim: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    metrics: dict[str, str] = field(default_factory=dict)
    windows: dict[str, tuple[int, int, int]] = field(default_factory=dict)

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT


@dataclass(frozen=True, slots=True)
class JobNote:
    """The outcome of one job: its key in the cache, or why it failed, and where in the code."""

    name: str
    key: str = ""
    code: str = ""
    seconds: float = 0.0
    found: bool = False
    failure: str = ""
    cpu_seconds: float = 0.0
    log: str = ""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT


@dataclass(frozen=True, slots=True)
class ArchiveFacts:
    """The archive whose sequences were used: its version is a hash over all of them."""

    version: str
    suite: str
    part: str
    secret_sha256: str = ""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT


@dataclass(frozen=True, slots=True)
class MeasuredCost:
    """What mapping the first window of a case costs with one method alone, in one thread.

    CPU time in s, and peak memory of the whole process, its libraries among it, in MB.
    """

    case: str
    cpu_seconds: _Amount
    peak_memory_mb: _Amount

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT


def platform_name() -> str:
    """Operating system, architecture and number of processors, without the machine's name."""
    return f"{platform.system()} {platform.release()}, {platform.machine()}, {os.cpu_count()} CPUs"


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """All numbers of a run, a suite or a study, and everything that made them.

    Attributes:
        rows: a table with the columns of `COLUMNS`, checked as `tidy` does.
        configuration: of a run: settings of scoring, `score`, and those of each case.
        samples: per case and seed, where its numbers came from; made of the rows if not given.
        versions: per program, its version where the numbers were collected.
        platform: operating system, architecture and processors.
        suite: name of the suite or study; empty for a run.
        subset: of the suite.
        digest: hash of the definition.
        definition: of the suite, as plain JSON values.
        cases: per case that was asked for, the hash over its part of the definition.
        seeds: that were asked for.
        jobs: what became of each.
        predictions: per method of others, the hash over its files and what their numbers mean.
        stated: per method of others, what its submitter says of it.
        cost: per method, what mapping a window costs here, where that was measured.
        archive: whose sequences were used; None where they were simulated.
        speed: per case, CPU time of the mapper over that of the calibration loop, repeated.
        schema_version: version of this layout.
    """

    rows: Rows
    configuration: dict[str, Any] = field(default_factory=dict)
    samples: tuple[Sample, ...] = ()
    versions: dict[str, str] = field(default_factory=versions)
    platform: str = field(default_factory=platform_name)
    suite: str = ""
    subset: str = ""
    digest: str = ""
    definition: dict[str, Any] = field(default_factory=dict)
    cases: dict[str, str] = field(default_factory=dict)
    seeds: tuple[int, ...] = ()
    jobs: tuple[JobNote, ...] = ()
    predictions: dict[str, str] = field(default_factory=dict)
    stated: dict[str, dict[str, Any]] = field(default_factory=dict)
    cost: dict[str, MeasuredCost] = field(default_factory=dict)
    archive: ArchiveFacts | None = None
    speed: dict[str, tuple[float, ...]] = field(default_factory=dict)
    schema_version: int = SCHEMA_VERSION

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT

    def __post_init__(self) -> None:
        rows = tidy(self.rows)
        seeds = {sample.case: sample.seed for sample in self.samples}
        if rows["seed"].isna().any():
            rows["seed"] = rows["seed"].fillna(rows["case"].map(seeds).astype("Int64"))
        object.__setattr__(self, "rows", rows)
        if not self.samples:
            object.__setattr__(self, "samples", samples_of(rows, {}, {}))

    @property
    def seed(self) -> int | None:
        """The seed of all samples; None where they have several, or nothing was simulated."""
        seeds = {sample.seed for sample in self.samples}
        return seeds.pop() if len(seeds) == 1 else None

    @property
    def sequences(self) -> dict[str, str]:
        """Per case the hash of its sequence, with the first seed."""
        known = {sample.case: sample.sequence for sample in reversed(self.samples)}
        return {case: sequence for case, sequence in known.items() if sequence}

    @property
    def metrics(self) -> dict[str, str]:
        """Per metric the hash of what it makes of fixed maps."""
        return {name: text for sample in self.samples for name, text in sample.metrics.items()}

    @property
    def case_names(self) -> tuple[str, ...]:
        """The cases that were asked for; of a run, those that have numbers."""
        return tuple(self.cases) or tuple(self.rows["case"].unique())

    @property
    def failures(self) -> tuple[JobNote, ...]:
        """The jobs that failed."""
        return tuple(job for job in self.jobs if job.failure)

    @property
    def code(self) -> dict[str, str]:
        """Short hashes of the code that made it, by stage."""
        codes: dict[str, dict[str, None]] = {}
        for job in self.jobs:
            if job.code:
                codes.setdefault(job.name.partition("/")[0], {})[job.code[:12]] = None
        return {stage: ", ".join(short) for stage, short in codes.items()}

    def to_dataframe(self) -> pd.DataFrame:
        """A copy of the table.

        Returns:
            Columns of texts, but `value`, `low` and `high` float64 with NaN, and `seed` and
            `support` Int64 with NA where there is none.
        """
        return self.rows.copy()

    @classmethod
    def from_dataframe(
        cls, frame: pd.DataFrame, *, seed: int | None = None,
        sequences: Mapping[str, str] | None = None, metrics: Mapping[str, str] | None = None,
        **provenance: Any,
    ) -> Results:  # fmt: skip
        """Makes results of a table such as `to_dataframe` gives; its index does not matter.

        Args:
            frame: one row per number. `seed`, `region`, `support`, `low` and `high` may be left
                out.
            seed: of rows that say none.
            sequences: per case, the sha256 of its sequence's manifest (or recording).
            metrics: per metric, the hash of what it makes of fixed maps.
            provenance: any of the attributes but `rows` and `samples`.

        Raises:
            InputError: a column that is missing, unknown or there twice, a cell of another type, or
                a unit that is not in `UNITS`.
        """
        if not hasattr(frame, "columns"):
            needed = "needs a DataFrame as `to_dataframe` returns it"
            raise InputError(f"a {type(frame).__name__}: {needed}")
        rows = tidy(frame, seed)
        if fault := unit_fault(rows):
            raise InputError(fault)
        return cls(rows, samples=samples_of(rows, sequences or {}, metrics or {}), **provenance)

    def __repr__(self) -> str:
        cases, methods, metrics = (
            list(self.rows[name].unique()) for name in ("case", "method", "metric")
        )
        methods = [method for method in methods if method not in (RIG, EVENTS)]
        return (
            f"Results({len(self.rows)} numbers of {', '.join(cases) or 'no case'}: "
            f"{len(metrics)} metrics of {', '.join(methods) or 'no method'})"
        )


def joined(parts: Sequence[Results], **about: Any) -> Results:
    """Results of several cases or seeds as one, each case and seed together.

    `about` are further attributes; its `configuration` goes before those of the parts.
    """
    samples = {(s.case, s.seed): s for part in reversed(parts) for s in part.samples}
    order = list(dict.fromkeys((s.case, s.seed) for part in parts for s in part.samples))
    place = {key: k for k, key in enumerate(order)}
    in_order = sorted(parts, key=lambda part: place[part.samples[0].case, part.samples[0].seed])
    configuration = about.pop("configuration", {})
    for part in parts:
        configuration = configuration | part.configuration
    return Results(
        together(part.rows for part in in_order), configuration,
        tuple(samples[key] for key in order), **about,
    )  # fmt: skip


def samples_of(
    rows: pd.DataFrame, sequences: Mapping[str, str], metrics: Mapping[str, str]
) -> tuple[Sample, ...]:
    """The samples of a table of which no more is known than the hashes of its sequences."""
    known = rows[["case", "seed"]].drop_duplicates().astype(object)
    pairs = known.where(known.notna(), None).itertuples(index=False)
    return tuple(
        Sample(case, seed, sequences.get(case, ""), metrics=dict(metrics)) for case, seed in pairs
    )


_RESULTS = TypeAdapter(Results)


def to_json(results: Results) -> str:
    """The text of a file of results: what made them indented for people, one row a line."""
    content = _RESULTS.dump_python(results, mode="json")
    content["samples"] = [_stated(sample) for sample in content["samples"]]
    return json_text(_stated(content), "rows")


def _stated(content: Mapping[str, Any]) -> dict[str, Any]:
    """Without what says nothing."""
    return {k: value for k, value in content.items() if value not in ("", None, {}, [])} | (
        {"rows": content["rows"]} if "rows" in content else {}
    )


def write_results(folder: str | Path, results: Results) -> None:
    """Writes `results.json` and `results.csv` into a folder; older ones are replaced atomically."""
    check_path("folder", folder)
    write_text(Path(folder) / JSON_NAME, to_json(results))
    write_csv(Path(folder) / CSV_NAME, results.rows)


def results_file(path: Path) -> Path:
    """The file of results that a path is, or that the folder holds: a suite's, or a run's."""
    names = (SUITE_NAME, JSON_NAME)
    return next(
        (path / name for name in names if (path / name).is_file()), file_in(path, JSON_NAME)
    )


@overload
def read_results(path: str | Path) -> Results: ...


@overload
def read_results(path: str | Path, of: Callable[[Results], Made]) -> Made: ...


def read_results(path: str | Path, of: Callable[[Results], Any] = lambda results: results) -> Any:
    """Reads the numbers of a run or suite: `results.json`, `suite.json`, or the folder of either.

    Args:
        path: the file or folder.
        of: makes of the results what is returned: what that does not find is the file's fault.

    Raises:
        InputError: no such file, or one that is damaged or of another version.
    """
    check_path("path", path)
    file = results_file(Path(path))
    if not file.is_file():
        raise InputError(
            f"{file}: no such file; `eventsweep run`, `score` and `suite` write results"
        )
    again = "run the suite again" if file.name == SUITE_NAME else "score the run again"
    return read_json(file, lambda content: of(results_from(content)), (1, 2, SCHEMA_VERSION), again)


def results_from(content: dict[str, Any]) -> Results:
    """The results in a file's content, of this or an earlier version."""
    return _RESULTS.validate_python({**_as_version_3(content), "schema_version": SCHEMA_VERSION})


def _as_version_3(content: dict[str, Any]) -> dict[str, Any]:
    """The content of a file of results; what is wrong with it is left for the reader to say."""
    version = content["schema_version"]
    if version == 3:
        return content
    if "samples" in content:
        return _of_suite(content, version)
    rows = content["rows"] if version > 1 else _rows_of_version_1(content["rows"])
    old = {name: content.pop(name, {}) for name in ("sequences", "metrics")}
    seed = content.pop("seed", None)
    samples = [
        {"case": case, "seed": seed, "sequence": old["sequences"].get(case, ""),
         "metrics": old["metrics"]}
        for case in dict.fromkeys(row["case"] for row in rows)
    ]  # fmt: skip
    return {**content, "samples": samples, "rows": _seeded(rows, seed)}


def _of_suite(content: Mapping[str, Any], version: int) -> dict[str, Any]:
    """Of version 1 every sample held its rows; of both, facts in a group of their own."""
    samples, rows = [], content.get("rows", [])
    for sample in content["samples"]:
        about = {**sample, **sample["facts"]}
        samples.append({name: about[name] for name in about if name not in ("facts", "rows")})
        if version == 1:
            rows = [*rows, *_seeded(_rows_of_version_1(sample["rows"]), about["seed"])]
    return {**content, "samples": samples, "rows": rows}


def _rows_of_version_1(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of a file of version 1, with today's names of columns."""
    return [{_COLUMNS_OF_1.get(name, name): cell for name, cell in row.items()} for row in rows]


def _seeded(rows: Iterable[Mapping[str, Any]], seed: int | None) -> list[dict[str, Any]]:
    return [{**row, "seed": seed if row.get("seed") is None else row["seed"]} for row in rows]


def mapper_method(method: str, mapper: str) -> str:
    """A method's name in the rows of a mapper that is not the default one."""
    return method if mapper == DEFAULT_MAPPER else f"{method} {mapper}"


def shown_name(method: str, mappers: Mapping[str, Mapping[str, Any]]) -> str:
    """A method without the name of its mapper, where that differs from the default in nothing else.

    A suite lists methods that are not run on every case under a mapper of their own.
    """
    name, space, mapper = method.partition(" ")
    default = mappers.get(DEFAULT_MAPPER, {})
    if not space or mapper not in mappers:
        return method
    own, usual = ({**settings, "methods": None} for settings in (mappers[mapper], default))
    return name if own == usual and name not in default.get("methods", ()) else method
