"""Numbers as people read them, in terminal and pages alike; files for programs hold plain ones.

Lengths and errors are stored in metres and read in centimetres; thousands are set apart by commas.
"""

from __future__ import annotations

import math

# Per unit as stored: the unit as shown, and the factor between them.
_DISPLAYED = {"m": ("cm", 100.0), "deg": ("°", 1.0), "deg/m": ("°/m", 1.0)}


_CLOCK_US = 10**10
"""Times beyond it, nearly three hours, are those of a clock and not of a recording's length."""


def shown_zero_us(first_us: int) -> int:
    """The time that pages show as 0, µs: the first one where times are those of a clock."""
    return first_us if first_us > _CLOCK_US else 0


def thousands(count: float) -> str:
    """A count, with commas between thousands and without decimals."""
    return f"{count:,.0f}"


def display_unit(unit: str) -> str:
    """The unit in which values of a stored unit are shown."""
    return _DISPLAYED.get(unit, (unit, 1.0))[0]


def in_display_unit(value: float, unit: str) -> float:
    """A stored value in the unit in which it is shown."""
    return _DISPLAYED.get(unit, (unit, 1.0))[1] * value


def displayed(value: float, unit: str) -> str:
    """A value as tables show it: metres as centimetres, counts without decimals, NaN as a dash."""
    if math.isnan(value):
        return "–"
    return thousands(value) if unit in ("px", "poses") else f"{in_display_unit(value, unit):,.2f}"
