"""What a suite's run says: its numbers, where they came from, and the outcome of its jobs."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar, overload

from pydantic import ConfigDict, Field, TypeAdapter

from eventsweep.emvs.utils.files import write_text
from eventsweep.emvs.utils.inputs import file_in
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.scoring.results import (
    Rows,
    json_text,
    platform_name,
    read_json,
    records,
    rows_of_version_1,
    tidy,
)

if TYPE_CHECKING:
    import pandas as pd

SCHEMA_VERSION = 2
FILE_NAME = "suite.json"
CSV_NAME, PICTURES_FOLDER = "suite.csv", "pictures"
DEFAULT_MAPPER = "default"
EVENTS = "events"
"""What stands in a row's place of a method where the row is about the events themselves."""

_STRICT = ConfigDict(extra="forbid")


def mapper_method(method: str, mapper: str) -> str:
    """A method's name in the rows of a mapper that is not the default one."""
    return method if mapper == DEFAULT_MAPPER else f"{method} {mapper}"


@dataclass(frozen=True, slots=True)
class SampleFacts:
    """Where a sample's numbers came from.

    Attributes:
        sequence: hash over the sequence's files.
        truth: hash of camera 0's ground truth.
        scene: hash over what defines the scene.
        metrics: per metric, the hash of what it makes of fixed maps.
    """

    sequence: str
    truth: str
    scene: str
    renderer: str
    sim: dict[str, Any]
    versions: dict[str, str]
    metrics: dict[str, str]

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT


@dataclass(frozen=True, slots=True)
class Sample:
    """One case with one seed, and where its numbers came from."""

    case: str
    seed: int
    facts: SampleFacts

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT


@dataclass(frozen=True, slots=True)
class JobNote:
    """The outcome of one job: its key in the cache, or why it failed."""

    name: str
    key: str = ""
    code: str = ""
    seconds: float = 0.0
    found: bool = False
    failure: str = ""
    cpu_seconds: float = 0.0

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT


@dataclass(frozen=True, slots=True)
class ArchiveFacts:
    """The archive whose sequences were used: its version is a hash over all of them."""

    version: str
    suite: str
    part: str
    secret_sha256: str = ""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT


Made = TypeVar("Made")
Amount = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class MeasuredCost:
    """What mapping the first window of a case costs with one method alone, in one thread.

    CPU time in s, and peak memory of the whole process, its libraries among it, in MB.
    """

    case: str
    cpu_seconds: Amount
    peak_memory_mb: Amount

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT


@dataclass(frozen=True, slots=True, eq=False)
class SuiteResult:
    """A whole run of a suite or a subset.

    Attributes:
        cases: per case that was asked for, the hash over its part of the definition.
        seeds: that were asked for.
        predictions: per method of others, the hash over its files and what their numbers mean.
        stated: per method of others, what its submitter says of it.
        cost: per method, what mapping a window costs here, where that was measured.
        archive: whose sequences were used; None where they were simulated.
        speed: per case, CPU time of the mapper over that of the calibration loop, repeated.
        versions: of everything that shapes the numbers, on the machine that collected them.
    """

    suite: str
    subset: str
    digest: str
    definition: dict[str, Any]
    cases: dict[str, str]
    seeds: tuple[int, ...]
    samples: tuple[Sample, ...]
    rows: Rows
    jobs: tuple[JobNote, ...] = ()
    predictions: dict[str, str] = field(default_factory=dict)
    stated: dict[str, dict[str, Any]] = field(default_factory=dict)
    cost: dict[str, MeasuredCost] = field(default_factory=dict)
    archive: ArchiveFacts | None = None
    speed: dict[str, tuple[float, ...]] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=versions)
    platform: str = field(default_factory=platform_name)
    schema_version: int = SCHEMA_VERSION

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT

    def __post_init__(self) -> None:
        object.__setattr__(self, "rows", tidy(self.rows))

    @property
    def failures(self) -> tuple[JobNote, ...]:
        """The jobs that failed."""
        return tuple(job for job in self.jobs if job.failure)

    @property
    def code(self) -> dict[str, str]:
        """Short hashes of the code that made it, by stage."""
        found: dict[str, dict[str, None]] = {}
        for job in self.jobs:
            if job.code:
                found.setdefault(job.name.partition("/")[0], {})[job.code[:12]] = None
        return {stage: ", ".join(codes) for stage, codes in found.items()}


_SAMPLE = TypeAdapter(Sample)
_RESULT = TypeAdapter(SuiteResult)


def sample_text(sample: Sample, rows: pd.DataFrame) -> str:
    """A sample with its numbers, as the text that `sample_from` reads."""
    content = {"sample": _SAMPLE.dump_python(sample, mode="json"), "rows": records(rows)}
    return json.dumps(content, ensure_ascii=False, allow_nan=False)


def sample_from(text: str) -> tuple[Sample, pd.DataFrame]:
    """Reads what `sample_text` wrote; the numbers say their seed."""
    content = json.loads(text)
    sample = _SAMPLE.validate_python(content["sample"])
    return sample, tidy(content["rows"], sample.seed)


def write_suite(folder: Path, result: SuiteResult) -> Path:
    """Writes `suite.json`, atomically, one row a line."""
    path = folder / FILE_NAME
    write_text(path, json_text(_RESULT.dump_python(result, mode="json"), "rows", indent=1))
    return path


@overload
def read_suite(path: Path) -> SuiteResult: ...


@overload
def read_suite(path: Path, of: Callable[[SuiteResult], Made]) -> Made: ...


def read_suite(path: Path, of: Callable[[SuiteResult], Any] = lambda result: result) -> Any:
    """Reads `suite.json`, given the file or its folder.

    `of` makes of it what is wanted: what that does not find is the file's fault.
    """
    made, schemas = lambda content: of(_validated(content)), (1, SCHEMA_VERSION)
    return read_json(file_in(path, FILE_NAME), made, schemas, "run the suite again")


def _validated(content: dict[str, Any]) -> SuiteResult:
    if content["schema_version"] == 1:
        content = _with_one_table(content)
    return _RESULT.validate_python({**content, "schema_version": SCHEMA_VERSION})


def _with_one_table(content: dict[str, Any]) -> dict[str, Any]:
    samples, rows = [], []
    for sample in content["samples"]:
        about = {name: value for name, value in sample.items() if name != "rows"}
        samples.append(about)
        rows += [{"seed": about["seed"], **row} for row in rows_of_version_1(sample["rows"])]
    return {**content, "samples": samples, "rows": rows}


def shown_name(method: str, mappers: Mapping[str, Mapping[str, Any]]) -> str:
    """A method without the name of its mapper, where that differs from the default in nothing else.

    A suite lists methods that are not run on every case under a mapper of their own.
    """
    name, space, mapper = method.partition(" ")
    default = mappers.get(DEFAULT_MAPPER, {})
    if not space or mapper not in mappers:
        return method
    own, usual = ({**one, "methods": None} for one in (mappers[mapper], default))
    return name if own == usual and name not in default.get("methods", ()) else method
