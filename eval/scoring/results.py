"""Scores on disk: `results.json` with provenance, and `results.csv` for everything else."""

from __future__ import annotations

import csv
import json
import math
import numbers
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import BeforeValidator, ConfigDict, PlainSerializer, TypeAdapter, ValidationError

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.parameters import first_fault
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.inputs import TABLE_BYTES, parse_json, read_text
from eventsweep.emvs.utils.runtime import versions

if TYPE_CHECKING:
    import pandas as pd

SCHEMA_VERSION = 1
JSON_NAME = "results.json"
CSV_NAME = "results.csv"
POOLED, MEAN = "all", "mean"
"""What rows call the pixels of all windows together, and the average over windows."""

Read = TypeVar("Read")
UNITS = ("m", "%", "px", "px·m", "cells", "x100", "x", "events")
"""Units of scores; `x` is a ratio, `x100` a number without unit a hundred times over."""

# JSON has no NaN: an undefined number travels as null.
Value = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(lambda value: value if math.isfinite(value) else None, when_used="json"),
]


RIG = "rig"
"""What stands in a row's place of a method where the row is about the cameras and their motion."""


@dataclass(frozen=True, slots=True)
class Row:
    """One number: of what, how much, in which unit, which direction is better, from which pixels.

    Attributes:
        case: scene or recording.
        window: a window's name, `all` for all windows pooled, `mean` for their plain average.
        method: as the paper names it.
        metric: unique within case, window and method: outside of region `all` its name begins
            with the region's, as in `common_mean_error`.
        value: the number; NaN where it is undefined.
        unit: of the value, and of `low` and `high`.
        better: the direction that is better.
        region: which pixels count, see `eval.scoring.regions`.
        points: how many pixels the value is made of; None where it is of no pixels.
        low: lower end of the 95 % confidence interval; None where none is known.
        high: its upper end.
    """

    case: str
    window: str
    method: str
    metric: str
    value: Value
    unit: str
    better: Literal["lower", "higher", "none"]
    region: str = "all"
    points: int | None = None
    low: float | None = None
    high: float | None = None

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")


def platform_name() -> str:
    """Operating system, architecture and number of processors, without the machine's name."""
    return f"{platform.system()} {platform.release()}, {platform.machine()}, {os.cpu_count()} CPUs"


@dataclass(frozen=True, slots=True)
class Results:
    """All rows of a run, and everything needed to say where they came from.

    Attributes:
        rows: the scores.
        configuration: the run's whole configuration, as plain JSON values.
        seed: seed of the run; None where nothing was simulated.
        sequences: per case, the sha256 of its sequence's manifest (or recording).
        versions: per program, its version.
        platform: operating system, architecture and processors.
        metrics: per metric, the hash of what it makes of fixed maps, as in a suite's samples.
        schema_version: version of this layout; another one is refused, never guessed at.
    """

    rows: tuple[Row, ...]
    configuration: dict[str, Any] = field(default_factory=dict)
    seed: int | None = None
    sequences: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=versions)
    platform: str = field(default_factory=platform_name)
    metrics: dict[str, str] = field(default_factory=dict)
    schema_version: int = SCHEMA_VERSION

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    def to_dataframe(self) -> pd.DataFrame:
        """The rows as a table, in their order.

        Returns:
            One column per attribute of `Row`: texts, but `value`, `low` and `high` float64 with NaN
            where there is none, and `points` Int64 with NA where there is none.
        """
        import pandas as pd  # 0.3 s that reading and writing files need not wait for

        return pd.DataFrame(
            {
                column.name: pd.Series(
                    [getattr(row, column.name) for row in self.rows],
                    dtype=_COLUMN_TYPES.get(column.name, "str"),
                )
                for column in fields(Row)
            }
        )

    @classmethod
    def from_dataframe(
        cls,
        frame: pd.DataFrame,
        *,
        configuration: Mapping[str, Any] | None = None,
        seed: int | None = None,
        sequences: Mapping[str, str] | None = None,
        metrics: Mapping[str, str] | None = None,
    ) -> Results:
        """Makes results of a table such as `to_dataframe` gives; its index does not matter.

        Args:
            frame: one row per number. `region`, `points`, `low` and `high` may be left out.
            configuration: of the run, as plain JSON values.
            seed: of the run.
            sequences: per case, the sha256 of its sequence's manifest (or recording).
            metrics: per metric, the hash of what it makes of fixed maps.

        Raises:
            InputError: a column that is missing, unknown or there twice, a cell of another type, or
                a unit that is not in `UNITS`.
        """
        return cls(
            _rows_of(frame), dict(configuration or {}), seed, dict(sequences or {}),
            metrics=dict(metrics or {}),
        )  # fmt: skip

    def __repr__(self) -> str:
        cases, methods, metrics = (
            list(dict.fromkeys(getattr(row, name) for row in self.rows))
            for name in ("case", "method", "metric")
        )
        methods = [method for method in methods if method != RIG]
        return (
            f"Results({len(self.rows)} numbers of {', '.join(cases) or 'no case'}: "
            f"{len(metrics)} metrics of {', '.join(methods) or 'no method'})"
        )


_RESULTS = TypeAdapter(Results)


_COLUMN_TYPES = {"value": "float64", "points": "Int64", "low": "float64", "high": "float64"}
_OPTIONAL = ("region", "points", "low", "high")


def _rows_of(frame: pd.DataFrame) -> tuple[Row, ...]:
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        raise InputError(
            f"a {type(frame).__name__}: needs a DataFrame as `to_dataframe` returns it"
        )
    known, given = [column.name for column in fields(Row)], frame.columns.tolist()
    missing = [name for name in known if name not in given and name not in _OPTIONAL]
    unknown = [name for name in given if name not in known or given.count(name) > 1]
    if missing or unknown:
        wrong = f"lacks {', '.join(missing)}" if missing else f"has {_shown(unknown)}"
        raise InputError(f"the table {wrong}: needs each once of {', '.join(known)}")
    columns = {name: _cells(frame[name], name) for name in given}
    return tuple(
        Row(**dict(zip(columns, cells, strict=True)))
        for cells in zip(*columns.values(), strict=True)
    )


def _cells(column: pd.Series[Any], name: str) -> list[Any]:
    """A column's cells as `Row` holds them."""
    good, plain, wanted = _CELLS.get(name, (_is_text, str, "a text"))
    nothing = math.nan if name == "value" else None
    found = []
    for k, (cell, lacks) in enumerate(zip(column.tolist(), column.isna(), strict=True)):
        if lacks and name in _COLUMN_TYPES:
            found.append(nothing)
        elif not lacks and good(cell):
            found.append(plain(cell))
        else:
            raise InputError(f"row {k} of the table: {name} is {_shown(cell)}, needs {wanted}")
    return found


def _shown(cell: object) -> str:
    """A cell in an error: on one line, of bounded length."""
    line = " ".join(repr(cell).split())
    return line if len(line) < 60 else f"{line[:50]}..."


def _is_text(cell: object) -> bool:
    return isinstance(cell, str)


def _is_number(cell: object) -> bool:
    return isinstance(cell, numbers.Real) and not isinstance(cell, bool)


def _is_count(cell: Any) -> bool:
    return _is_number(cell) and cell >= 0 and cell % 1 == 0


def _one_of(words: Sequence[str]) -> Callable[[Any], bool]:
    return lambda cell: _is_text(cell) and cell in words


_DIRECTIONS = ("lower", "higher", "none")
_CELLS: dict[str, tuple[Callable[[Any], bool], Callable[[Any], Any], str]] = {
    "value": (_is_number, float, "a number"),
    "points": (_is_count, int, "a whole number of pixels or nothing"),
    "low": (_is_number, float, "a number or nothing"),
    "high": (_is_number, float, "a number or nothing"),
    "unit": (_one_of(UNITS), str, f"one of {', '.join(UNITS)}: convert the values"),
    "better": (_one_of(_DIRECTIONS), str, f"one of {', '.join(_DIRECTIONS)}"),
}


def write_results(out_dir: Path, results: Results) -> None:
    """Writes `results.json` and `results.csv` into `out_dir`, each atomically."""
    with atomic_path(out_dir / JSON_NAME) as path:
        path.write_text(to_json(results), encoding="utf-8")
    with atomic_path(out_dir / CSV_NAME) as path:
        _write_csv(path, results.rows)


def read_results(path: Path) -> Results:
    """Reads `results.json`, given the file or its folder.

    Raises:
        InputError: the file is missing, truncated, of another schema version or malformed.
    """
    file = path / JSON_NAME if path.is_dir() else path
    if not file.is_file():
        raise InputError(f"{file}: no such file; `eventsweep run` and `eventsweep score` write it")
    return read_json(file, _RESULTS.validate_python, SCHEMA_VERSION, "score the run again")


def read_json(
    file: Path, validate: Callable[[Any], Read], version: int | None, cure: str, name: str = ""
) -> Read:
    """Reads a JSON file that this program wrote.

    Args:
        file: its path.
        validate: makes the result of the file's content; raises pydantic's error where it cannot.
        version: the `schema_version` that it must have; None where it has none.
        cure: what to do where the file cannot be used, in words.
        name: how errors call the file, if not by its path.

    Raises:
        InputError: the file is missing, truncated, of another schema version or malformed.
    """
    name = name or str(file)
    try:
        content = parse_json(read_text(file, TABLE_BYTES))
    except OSError as error:
        raise InputError(f"{name}: cannot be read ({error.strerror}); {cure}") from error
    except ValueError as error:
        raise InputError(f"{name}: not complete JSON ({error}); {cure}") from error
    if version is not None:
        _check_version(name, content, version, cure)
    try:
        return validate(content)
    except ValidationError as error:
        raise InputError(f"{name}: {first_fault(error)}; {cure}") from error


def _check_version(name: str, content: object, version: int, cure: str) -> None:
    stored = content.get("schema_version") if isinstance(content, dict) else None
    if stored != version:
        raise InputError(
            f"{name}: schema version {stored}, but this program reads {version}; {cure} with this "
            "version"
        )


def to_json(results: Results) -> str:
    """The text of `results.json`: provenance indented for people, one row a line for diffs."""
    content = _RESULTS.dump_python(results, mode="json")
    lines = [json.dumps(row, ensure_ascii=False) for row in content.pop("rows")]
    head = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False).removesuffix("\n}")
    body = ",\n    ".join(lines)
    return (
        f'{head},\n  "rows": [\n    {body}\n  ]\n}}\n' if lines else f'{head},\n  "rows": []\n}}\n'
    )


def _write_csv(path: Path, rows: Sequence[Row]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(column.name for column in fields(Row))
        for row in rows:
            cells = astuple(row)
            writer.writerow("" if is_undefined(cell) else cell for cell in cells)


def is_undefined(cell: object) -> bool:
    """Whether a table shows nothing there."""
    return cell is None or (isinstance(cell, float) and not math.isfinite(cell))
