"""Algorithm 2 by name: fusion across cameras and over sub-intervals of time, in either order.

The name is a composition of functions and reads as in the paper: in `AtHc@4` the harmonic mean
across cameras (`Hc`) comes first, in each of 4 sub-intervals, then the arithmetic mean over time
(`At`). In `HcAt@4` each camera's votes are averaged over time first.
"""

from __future__ import annotations

import re

from emvs.dsi import fusion_kernels
from emvs.dsi.method import CODES, MEANS, Method, Split
from emvs.errors import InputError

MAX_INTERVALS = 64
GRAMMAR = "Alg2/<F>t<F>c@n[/time][~] or Alg2/<F>c<F>t@n[/time] with <F> of min, H, G, A, RMS, max"
SUMMARY = (
    "fused across cameras (c) and over n sub-intervals of equal count (/time: equal time), the "
    "right-hand fusion first; ~ pairs sub-intervals half a window apart"
)
EXAMPLES = ("Alg2/AtHc@4", "Alg2/HcAt@2/time", "Alg2/AtHc@2~")

_F = "min|max|RMS|H|G|A"
_PATTERN = re.compile(rf"Alg2/({_F})([ct])({_F})([ct])@([1-9]\d*)(/time)?(~)?")
_AXIS = {"c": "across cameras", "t": "over time"}


def build(name: str, mcemvs: bool = False) -> Method:
    """Makes the method of a name.

    Args:
        name: such as `Alg2/AtHc@4`.
        mcemvs: the compatibility setting, whose H across cameras is 2ab / (a + b + 0.1).

    Raises:
        InputError: a name that does not follow the grammar, or asks for what makes no difference.
    """
    match = _PATTERN.fullmatch(name)
    if match is None:
        raise InputError(f"unknown method {name!r}: Algorithm 2 is named {GRAMMAR}")
    outer, outer_axis, inner, inner_axis, count, by_time, shuffle = match.groups()
    _check(name, outer_axis, inner_axis, int(count), shuffled=shuffle is not None)
    return Method(
        name,
        _code(inner, inner_axis, mcemvs),
        _summary(match),
        Split(int(count), "time" if by_time else "count"),
        outer=_code(outer, outer_axis, mcemvs),
        time_first=inner_axis == "t",
        shuffled=shuffle is not None,
    )


def _check(name: str, outer_axis: str, inner_axis: str, count: int, *, shuffled: bool) -> None:
    if outer_axis == inner_axis:
        raise InputError(
            f"{name}: fuses twice {_AXIS[inner_axis]}; needs one c and one t, such as Alg2/AtHc@4"
        )
    if count > MAX_INTERVALS:
        raise InputError(f"{name}: {count} sub-intervals; at most {MAX_INTERVALS}")
    if shuffled and (count == 1 or inner_axis == "t"):
        raise InputError(
            f"{name}: shuffling changes nothing here; it needs 2 or more sub-intervals and the "
            "fusion across cameras first, such as Alg2/AtHc@2~"
        )


def _code(fusion: str, axis: str, mcemvs: bool) -> int:
    if mcemvs and fusion == "H" and axis == "c":
        return fusion_kernels.HARMONIC_EPS
    return CODES[fusion]


def _summary(match: re.Match[str]) -> str:
    outer, outer_axis, inner, inner_axis, count, by_time, shuffle = match.groups()
    kind = "time" if by_time else "count"
    return (
        f"{count} sub-intervals of equal {kind}{', shuffled' if shuffle else ''}; fused "
        f"{_AXIS[inner_axis]} by the {MEANS[inner]}, then {_AXIS[outer_axis]} by the {MEANS[outer]}"
    )
