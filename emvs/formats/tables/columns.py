"""Which column of a table of events is what: by name, as stated, or by what the values can be.

A column's address is its name (`ev/x` of HDF5, `x` of a header), with a field or a number in
brackets where several lie in one data set (`CD/events[x]`, `events[0]`); a bare number counts from
0 where columns have no names.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, quoted

UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# What a column's name says of its unit; None: µs where whole, seconds where floating
TIMES: Mapping[str, float | None] = {
    "t_us": 1e-6,
    "t_ns": 1e-9,
    "t_ms": 1e-3,
    "t_s": 1.0,
    **dict.fromkeys(("t", "ts", "time", "timestamp", "timestamps")),
}
POLARITIES = ("p", "pol", "polarity", "on")
ORDERS = ("txyp", "xytp")
CURE = "set `columns` (x=..., y=..., t=..., p=...) and `time_unit` (s, ms, us, ns)"
_ADDRESS = re.compile(r"(?P<name>[^\[\]]*)(?:\[(?P<key>[^\[\]]+)\])?")


@dataclass(frozen=True)
class ColumnMap:
    """States which column of a table holds what.

    Attributes:
        x: address of pixel columns; empty, as all four, where only the unit is stated.
        y: that of pixel rows.
        t: that of times.
        p: that of polarity: 0 or -1 for darker, 1 for brighter, or false and true.
        time_unit: what times count: `s`, `ms`, `us` or `ns`.

    Raises:
        InputError: some of the columns, an unknown unit, columns without a unit, an address that
            is none, or nothing at all.
    """

    x: str = ""
    y: str = ""
    t: str = ""
    p: str = ""
    time_unit: str = ""

    def __post_init__(self) -> None:
        missing = [name for name, address in self.addresses.items() if not address]
        if missing and len(missing) < 4:
            raise InputError(f"columns: {', '.join(missing)} missing; needs x, y, t and p")
        if self.time_unit not in UNITS_S and (self.time_unit or not missing):
            raise InputError(
                f"time_unit {self.time_unit!r}: columns need one of {', '.join(UNITS_S)}"
            )
        if not any(astuple(self)):
            raise InputError(f"columns: none given; {CURE}")
        for address in self.addresses.values():
            address_of(address)

    @property
    def addresses(self) -> dict[str, str]:
        """The addresses of x, y, t and p."""
        return {"x": self.x, "y": self.y, "t": self.t, "p": self.p}

    @property
    def unit_s(self) -> float | None:
        """What times count, s; None where it is not stated."""
        return UNITS_S.get(self.time_unit)


def column_map(columns: str = "", time_unit: str = "") -> ColumnMap | None:
    """What `x=...,y=...,t=...,p=...` and a unit state; None where both are empty."""
    if not (columns or time_unit):
        return None
    pairs = [part.partition("=") for part in columns.split(",") if part.strip()]
    stated = {name.strip(): address.strip() for name, _, address in pairs}
    if len(stated) < len(pairs) or not set(stated) <= set("xytp"):
        raise InputError(f"columns {quoted(columns)}: needs x=..., y=..., t=..., p=..., each once")
    return ColumnMap(**stated, time_unit=time_unit)


def address_of(address: str) -> tuple[str, str]:
    """Name and key of an address, such as `events` and `0` of `events[0]`."""
    match = _ADDRESS.fullmatch(address)
    if match is None:
        raise InputError(f"column {quoted(address)}: needs a name, with one [field] or [number]")
    return match["name"], match["key"] or ""


def by_names(where: str, names: Collection[str]) -> tuple[ColumnMap, float | None]:
    """The columns whose names say what they are, and the unit that the time's name says, s."""
    times = [name for name in TIMES if name in names]
    signs = [name for name in POLARITIES if name in names]
    if len(times) != 1 or len(signs) != 1 or not {"x", "y"} <= set(names):
        raise InputError(
            f"{where}: columns {quoted(*sorted(names)) or 'none'}; needs x, y, one of "
            f"{', '.join(POLARITIES)} and one of {', '.join(TIMES)}: rename them, or {CURE}"
        )
    return ColumnMap("x", "y", times[0], signs[0], "us"), TIMES[times[0]]


def order_of(where: str, columns: Sequence[NDArray[Any]]) -> str:
    """Which of `ORDERS` is the only one that the values of four nameless columns (N,) allow.

    They are best of the file's end, where times are largest.
    """
    possible = [
        order
        for order in ORDERS
        if all(_may_be(name, values) for name, values in zip(order, columns, strict=True))
    ]
    if len(possible) != 1:
        both = (
            "either t, x, y, p or x, y, t, p" if possible else "neither t, x, y, p nor x, y, t, p"
        )
        raise InputError(f"{where}: four unnamed columns, whose values fit {both}; {CURE}")
    return possible[0]


def _may_be(name: str, values: NDArray[Any]) -> bool:
    if name == "t":
        return bool((values >= 0).all())
    if name == "p":
        return bool(np.isin(values, (-1, 0, 1)).all())
    inside = (values >= 0) & (values <= 65535)
    return bool(inside.all() and (values == np.floor(values)).all())


def nameless_unit_s(where: str, t: NDArray[Any]) -> float:
    """What the times of a nameless column count, s: µs where of a whole type, else seconds."""
    if t.dtype.kind != "f":
        return 1e-6
    if (t == np.floor(t)).all():
        raise InputError(f"{where}: times of type {t.dtype} without fractions; set `time_unit`")
    return 1.0
