"""Which column of a table of events is what: by name, as stated, or by what the values can be.

A column's address is its name (`ev/x` of HDF5, `x` of a header), with a field or a number in
brackets where several lie in one data set (`CD/events[x]`, `events[0]`); a bare number counts from
0 where columns have no names.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.headers import POLARITIES, agreed_unit, check_whole_us, column_of
from eventsweep.emvs.errors import InputError, quoted

UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Usual names of times; those without a unit count µs where whole, seconds where floating
TIMES = ("t_us", "t_ns", "t_ms", "t_s", "t", "ts", "time", "timestamp", "timestamps")
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
        agreed_unit("columns", self._named_unit, self.time_unit)

    @property
    def addresses(self) -> dict[str, str]:
        """The addresses of x, y, t and p."""
        return {"x": self.x, "y": self.y, "t": self.t, "p": self.p}

    @property
    def _named_unit(self) -> str:
        """The unit that the name of the times says, or empty."""
        name, key = address_of(self.t)
        said = column_of(key or name.rpartition("/")[2])
        return said.unit if said.role == "t" and said.unit in UNITS_S else ""

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


def by_names(where: str, names: Collection[str]) -> tuple[dict[str, str], float | None]:
    """The addresses whose names say what they are, and the unit that the time's name says, s."""
    times = [name for name in TIMES if name in names]
    times = times or [name for name in names if column_of(name).role == "t"]
    signs = [name for name in POLARITIES if name in names]
    if len(times) != 1 or len(signs) != 1 or not {"x", "y"} <= set(names):
        raise InputError(
            f"{where}: columns {quoted(*sorted(names)) or 'none'}; needs x, y, one of "
            f"{', '.join(POLARITIES)} and one of {', '.join(TIMES)}: rename them, or {CURE}"
        )
    addresses = {"x": "x", "y": "y", "t": times[0], "p": signs[0]}
    return addresses, UNITS_S.get(column_of(times[0]).unit)


def agreed_unit_s(where: str, named_s: float | None, stated: ColumnMap | None) -> float | None:
    """What times count, s, by a column's name or as stated, which must agree; None: neither."""
    unit_s = None if stated is None else stated.unit_s
    words = [{s: unit for unit, s in UNITS_S.items()}.get(s or 0.0, "") for s in (named_s, unit_s)]
    return UNITS_S.get(agreed_unit(where, *words))


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
        if len(t):
            check_whole_us(where, int(t[0]))
        return 1e-6
    if (t == np.floor(t)).all():
        raise InputError(f"{where}: times of type {t.dtype} without fractions; set `time_unit`")
    return 1.0
