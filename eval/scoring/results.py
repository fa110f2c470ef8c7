"""Scores as one tidy table, and `results.json` and `results.csv`, which hold it with provenance.

A row is one number: of what, how much, in which unit, which direction is better, of which pixels.
Everything that is scored, gated, compared or ranked is such a table, read and written here.
"""

from __future__ import annotations

import json
import math
import numbers
import os
import platform
from collections import namedtuple
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar, get_args

from pydantic import BeforeValidator, ConfigDict, PlainSerializer, TypeAdapter, ValidationError

from eventsweep.emvs.errors import InputError, check_path, quoted, said
from eventsweep.emvs.parameters import first_fault
from eventsweep.emvs.utils.files import atomic_path, write_text
from eventsweep.emvs.utils.inputs import TABLE_BYTES, file_in, parse_json, read_text
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.scoring.direction import Direction

if TYPE_CHECKING:
    import pandas as pd

SCHEMA_VERSION = 2
JSON_NAME = "results.json"
CSV_NAME = "results.csv"
POOLED, MEAN = "all", "mean"
"""Windows of rows about the pixels of all windows together, and about the average over windows."""
RIG = "rig"
"""Method of rows about the cameras and their motion."""
UNITS = (
    "m", "%", "px", "px·m", "cells", "x100", "x", "events", "deg", "deg/m", "s", "poses",
)  # fmt: skip
"""Units of scores; `x` is a ratio, `x100` a number without unit a hundred times over."""

COLUMNS = {
    "case": "a text",
    "seed": "a whole number or nothing",
    "window": "a text",
    "method": "a text",
    "metric": "a text",
    "value": "a number",
    "unit": "a text",
    "direction": f"one of {', '.join(get_args(Direction))}",
    "region": "a text",
    "support": "a whole number of pixels, poses or pairs, or nothing",
    "low": "a number or nothing",
    "high": "a number or nothing",
}
"""The columns of a table of scores, and what their cells must be.

Case is a scene or recording. Window is a window's name, `all` or `mean`. Metric is unique within
case, seed, window and method: outside of region `all` its name begins with the region's, as in
`common_mean_error`. Value is NaN where it is undefined. Region says which pixels count, see
`eval.scoring.regions`; support is how many there are. Low and high are the ends of the 95 %
confidence interval, where one is known.
"""
_TYPES = {"value": "float64", "low": "float64", "high": "float64", "seed": "Int64",
          "support": "Int64"}  # fmt: skip
_OPTIONAL = ("seed", "region", "support", "low", "high")
_OF_VERSION_1 = {"better": "direction", "points": "support"}
Read = TypeVar("Read")

# JSON has no NaN: an undefined number travels as null.
Value = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(lambda value: value if math.isfinite(value) else None, when_used="json"),
]


def tidy(rows: pd.DataFrame | Iterable[Mapping[str, Any]], seed: int | None = None) -> pd.DataFrame:
    """A checked table with every column of `COLUMNS` in their order; its index counts.

    `seed`, `region`, `support`, `low` and `high` may be left out; `seed` is that of rows that lack
    one.
    """
    import pandas as pd  # 0.3 s, which help and mapping need not wait for

    frame = rows if isinstance(rows, pd.DataFrame) else pd.DataFrame(list(rows))
    if frame.columns.empty:
        frame = pd.DataFrame(columns=list(COLUMNS), dtype=object)
    _check_columns(frame.columns.tolist())
    filled = frame.reset_index(drop=True)
    filled = filled.assign(**{name: None for name in _OPTIONAL if name not in frame})
    filled["region"] = filled["region"].fillna("all")
    columns = {name: _checked(filled[name], name) for name in COLUMNS}
    if seed is not None:
        columns["seed"] = columns["seed"].fillna(seed)
    return pd.DataFrame(columns)


def _check_columns(given: list[Any]) -> None:
    missing = [name for name in COLUMNS if name not in given and name not in _OPTIONAL]
    unknown = [name for name in given if name not in COLUMNS or given.count(name) > 1]
    if missing or unknown:
        wrong = f"lacks {', '.join(missing)}" if missing else f"has {_short(unknown)}"
        raise InputError(f"the table {wrong}: needs each of these once: {', '.join(COLUMNS)}")


def _checked(column: pd.Series[Any], name: str) -> pd.Series[Any]:
    if name not in _TYPES or column.dtype.kind not in "fiu" or name in ("seed", "support"):
        good = _is_good(name)
        for k, (cell, is_missing) in enumerate(zip(column.tolist(), column.isna(), strict=True)):
            if not (good(cell) or (is_missing and name in _TYPES)):
                wanted = COLUMNS[name]
                raise InputError(f"row {k} of the table: {name} is {_short(cell)}, needs {wanted}")
    dtype: Any = _TYPES.get(name, "str")
    checked: pd.Series[Any] = column.astype(dtype)
    return checked


def _is_good(name: str) -> Callable[[Any], bool]:
    if name in ("seed", "support"):
        return lambda cell: _is_number(cell) and 0 <= cell < 1 << 63 and cell % 1 == 0
    if name in _TYPES:
        return _is_number
    choices = get_args(Direction) if name == "direction" else None
    return lambda cell: isinstance(cell, str) and (choices is None or cell in choices)


def _is_number(cell: object) -> bool:
    return isinstance(cell, numbers.Real) and not isinstance(cell, bool)


def _short(cell: object) -> str:
    """A cell in an error: on one line, of bounded length."""
    line = " ".join(repr(cell).split())
    return line if len(line) < 60 else f"{line[:50]}..."


def together(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Tables one below the other."""
    import pandas as pd

    return pd.concat([tidy(()), *tables], ignore_index=True)


def each(rows: pd.DataFrame) -> Iterator[Any]:
    """The rows, with a column's cell as attribute of its name."""
    # As `itertuples` does, which makes a type anew each time: for a few rows that is most of it.
    cells = (column.tolist() for _, column in rows.items())
    return map(_row_type(tuple(rows.columns))._make, zip(*cells, strict=True))


@cache
def _row_type(names: tuple[str, ...]) -> Any:
    return namedtuple("Row", names, rename=True)


def records(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows as plain JSON values; null where there is no number."""
    finite = rows.replace([math.inf, -math.inf], math.nan)
    plain: Any = finite.astype(object).where(finite.notna(), None)
    found: list[dict[str, Any]] = plain.to_dict("records")
    return found


if TYPE_CHECKING:
    Rows = pd.DataFrame
else:
    Rows = Annotated[Any, PlainSerializer(records)]


def platform_name() -> str:
    """Operating system, architecture and number of processors, without the machine's name."""
    return f"{platform.system()} {platform.release()}, {platform.machine()}, {os.cpu_count()} CPUs"


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """All numbers of a run, and everything needed to say where they came from.

    Attributes:
        rows: a table with the columns of `COLUMNS`, checked as `tidy` does.
        configuration: the run's whole configuration, as plain JSON values.
        seed: seed of the run; None where nothing was simulated.
        sequences: per case, the sha256 of its sequence's manifest (or recording).
        versions: per program, its version.
        platform: operating system, architecture and processors.
        metrics: per metric, the hash of what it makes of fixed maps, as in a suite's samples.
        schema_version: version of this layout.
    """

    rows: Rows
    configuration: dict[str, Any] = field(default_factory=dict)
    seed: int | None = None
    sequences: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=versions)
    platform: str = field(default_factory=platform_name)
    metrics: dict[str, str] = field(default_factory=dict)
    schema_version: int = SCHEMA_VERSION

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    def __post_init__(self) -> None:
        object.__setattr__(self, "rows", tidy(self.rows, self.seed))

    def to_dataframe(self) -> pd.DataFrame:
        """A copy of the table.

        Returns:
            Columns of texts, but `value`, `low` and `high` float64 with NaN, and `seed` and
            `support` Int64 with NA where there is none.
        """
        return self.rows.copy()

    @classmethod
    def from_dataframe(cls, frame: pd.DataFrame, **provenance: Any) -> Results:
        """Makes results of a table such as `to_dataframe` gives; its index does not matter.

        Args:
            frame: one row per number. `seed`, `region`, `support`, `low` and `high` may be left
                out.
            provenance: any of the attributes but `rows`.

        Raises:
            InputError: a column that is missing, unknown or there twice, a cell of another type, or
                a unit that is not in `UNITS`.
        """
        if not hasattr(frame, "columns"):
            needed = "needs a DataFrame as `to_dataframe` returns it"
            raise InputError(f"a {type(frame).__name__}: {needed}")
        results = cls(frame, **provenance)
        for k, unit in enumerate(results.rows["unit"]):
            if unit not in UNITS:
                wanted = f"one of {', '.join(UNITS)}: convert the values"
                raise InputError(f"row {k} of the table: unit is {_short(unit)}, needs {wanted}")
        return results

    def __repr__(self) -> str:
        cases, methods, metrics = (
            list(self.rows[name].unique()) for name in ("case", "method", "metric")
        )
        methods = [method for method in methods if method != RIG]
        return (
            f"Results({len(self.rows)} numbers of {', '.join(cases) or 'no case'}: "
            f"{len(metrics)} metrics of {', '.join(methods) or 'no method'})"
        )


_RESULTS = TypeAdapter(Results)


def write_results(folder: str | Path, numbers: Results) -> None:
    """Writes `results.json` and `results.csv` into a folder; older ones are replaced atomically."""
    check_path("folder", folder)
    write_text(Path(folder) / JSON_NAME, to_json(numbers))
    write_csv(Path(folder) / CSV_NAME, numbers.rows)


def write_csv(path: Path, rows: pd.DataFrame) -> None:
    """Writes a table atomically; undefined numbers are empty."""
    with atomic_path(path) as partial:
        finite = rows.replace([math.inf, -math.inf], math.nan)
        finite.to_csv(partial, index=False, lineterminator="\n", encoding="utf-8")


def read_results(path: str | Path) -> Results:
    """Reads the numbers of a run: `results.json`, or the folder that holds it.

    Raises:
        InputError: no such file, or one that is damaged or of another version.
    """
    check_path("path", path)
    file = file_in(Path(path), JSON_NAME)
    if not file.is_file():
        raise InputError(f"{file}: no such file; `eventsweep run` and `eventsweep score` write it")
    return read_json(file, _validated, (1, SCHEMA_VERSION), "score the run again")


def _validated(content: dict[str, Any]) -> Results:
    if content["schema_version"] == 1 and "rows" in content:
        content = {**content, "rows": rows_of_version_1(content["rows"])}
    return _RESULTS.validate_python({**content, "schema_version": SCHEMA_VERSION})


def rows_of_version_1(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of a file of version 1, with today's names of columns."""
    return [{_OF_VERSION_1.get(name, name): cell for name, cell in row.items()} for row in rows]


def read_json(
    file: Path, validate: Callable[[Any], Read], versions: tuple[int, ...], cure: str,
    name: str = "",
) -> Read:  # fmt: skip
    """Reads a JSON file that this program wrote.

    Args:
        file: its path.
        validate: makes the result of the file's content; raises pydantic's error or `InputError`
            where it cannot.
        versions: the values of `schema_version` that can be read; empty where it has none.
        cure: what to do where the file cannot be used, in words.
        name: how errors call the file, if not by its path.
    """
    name = name or str(file)
    try:
        content = parse_json(read_text(file, TABLE_BYTES))
    except OSError as error:
        raise InputError(f"{name}: cannot be read ({error.strerror}); {cure}") from error
    except ValueError as error:
        raise InputError(f"{name}: not complete JSON ({error}); {cure}") from error
    stored = content.get("schema_version") if isinstance(content, dict) else None
    if versions and stored not in versions:
        known = " and ".join(map(str, versions))
        raise InputError(
            f"{name}: schema version {quoted(stored)}, but this program reads {known}; {cure} with "
            "this version"
        )
    try:
        return validate(content)
    except ValidationError as error:
        raise InputError(f"{name}: {first_fault(error)}; {cure}") from error
    except (AttributeError, LookupError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: {said(error, 400)}; {cure}") from error


def to_json(results: Results) -> str:
    """The text of `results.json`: provenance indented for people, one row a line for diffs."""
    return json_text(_RESULTS.dump_python(results, mode="json"), "rows", indent=2)


def json_text(content: dict[str, Any], table: str, indent: int) -> str:
    """JSON in which the objects of one list, put last, take a line each."""
    pad = " " * indent
    lines = [json.dumps(row, ensure_ascii=False, allow_nan=False) for row in content.pop(table)]
    head = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False)
    body = f",\n{pad * 2}".join(lines)
    filled = f"\n{pad * 2}{body}\n{pad}" if lines else ""
    return f'{head.removesuffix(f"{chr(10)}}}")},\n{pad}"{table}": [{filled}]\n}}\n'
