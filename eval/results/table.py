"""Scores as one tidy table.

A row is one number: of what, how much, in which unit, which direction is better, of which pixels.
Everything that is scored, gated, compared or ranked is such a table.
"""

from __future__ import annotations

import math
import numbers
from collections import namedtuple
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

from pydantic import BeforeValidator, PlainSerializer

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.eval.results.direction import Direction

if TYPE_CHECKING:
    import pandas as pd

POOLED, MEAN = "all", "mean"
"""Windows of rows about the pixels of all windows together, and about the average over windows."""
RIG = "rig"
"""Method of rows about the cameras and their motion."""
EVENTS = "events"
"""What stands in a row's place of a method where the row is about the events themselves."""
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
    if not _is_sound(column, name):
        good = _is_good(name)
        for k, (cell, is_missing) in enumerate(zip(column.tolist(), column.isna(), strict=True)):
            if not (good(cell) or (is_missing and name in _TYPES)):
                wanted = COLUMNS[name]
                raise InputError(f"row {k} of the table: {name} is {_short(cell)}, needs {wanted}")
    dtype: Any = _TYPES.get(name, "str")
    checked: pd.Series[Any] = column.astype(dtype)
    return checked


def _is_sound(column: pd.Series[Any], name: str) -> bool:
    """Whether a column shows by its type alone that every cell is good: most do."""
    import pandas as pd

    if name in ("seed", "support"):
        known = column.dropna()
        whole = known.dtype.kind in "iu"
        return whole and (known.empty or bool(known.min() >= 0))
    if name in _TYPES:
        return column.dtype.kind in "fiu"
    if column.isna().any() or pd.api.types.infer_dtype(column, skipna=False) != "string":
        return False
    return name != "direction" or bool(column.isin(get_args(Direction)).all())


def _is_good(name: str) -> Callable[[Any], bool]:
    if name in ("seed", "support"):
        return lambda cell: _is_number(cell) and 0 <= cell < 1 << 63 and cell % 1 == 0
    if name in _TYPES:
        return _is_number
    choices = get_args(Direction) if name == "direction" else None
    return lambda cell: isinstance(cell, str) and (choices is None or cell in choices)


def _is_number(cell: object) -> bool:
    return isinstance(cell, numbers.Real) and not isinstance(cell, bool)


def unit_fault(rows: pd.DataFrame) -> str:
    """What is wrong with the units of a table; empty where each is one of `UNITS`."""
    unknown = rows[~rows["unit"].isin(UNITS)]
    if unknown.empty:
        return ""
    unit, wanted = unknown["unit"].iloc[0], f"one of {', '.join(UNITS)}: convert the values"
    return f"row {unknown.index[0]} of the table: unit is {_short(unit)}, needs {wanted}"


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


def write_csv(path: Path, rows: pd.DataFrame) -> None:
    """Writes a table atomically; undefined numbers are empty."""
    with atomic_path(path) as partial:
        finite = rows.replace([math.inf, -math.inf], math.nan)
        finite.to_csv(partial, index=False, lineterminator="\n", encoding="utf-8")
