"""Which of two numbers is better: the one place that knows what a direction means."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

Direction = Literal["lower", "higher", "none"]
"""The end of a metric that is better; `none` where there is no better end."""
Change = Literal["better", "worse", "equal", "changed"]


def change_of(difference: float, direction: Direction, tolerance: float = 0.0) -> Change:
    """What a new value is that differs by so much from the one before, up to `tolerance` `equal`.

    NaN is `changed`, and so is every other difference where there is no better end.
    """
    if abs(difference) <= tolerance:
        return "equal"
    if direction == "none" or math.isnan(difference):
        return "changed"
    return "better" if (difference < 0) == (direction == "lower") else "worse"


def badness(value: float, direction: Direction) -> tuple[bool, float]:
    """A key that sorts the best first and NaN last; without a direction, small ones first."""
    return math.isnan(value), -value if direction == "higher" else value


def best(values: Iterable[float], direction: Direction) -> float:
    """The best of some values; NaN where none is finite or there is no better end."""
    known = [value for value in values if math.isfinite(value)]
    if not known or direction == "none":
        return math.nan
    return max(known) if direction == "higher" else min(known)
