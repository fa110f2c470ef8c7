"""Fusions by name: `H`, `cam0`, and the compositions of Algorithm 2.

The name of an Algorithm 2 is a composition of functions and reads as in the paper: in `AtHc@4` the
harmonic mean across cameras (`Hc`) comes first, in each of 4 sub-intervals, then the arithmetic
mean over time (`At`). In `HcAt@4` each camera's votes are averaged over time first.
"""

from __future__ import annotations

import re

from eventsweep.emvs.dsi import fusion_kernels
from eventsweep.emvs.dsi.fusion import MEANS, Fusion, Split
from eventsweep.emvs.dsi.method import MethodName
from eventsweep.emvs.errors import InputError

MAX_INTERVALS = 64
_F = "min|max|RMS|H|G|A"
_COMPOSED = re.compile(rf"({_F})([ct])({_F})([ct])@([1-9]\d*)(/time)?(~)?")
_AXIS = {"c": "across cameras", "t": "over time"}


def named_fusion(name: str, *, mcemvs: bool = False) -> tuple[Fusion | None, str]:
    """The fusion that a method's variant names, and what it does; None where none has the name.

    The variant is a mean such as `H`, `camK`, or an Algorithm 2 such as `AtHc@4`.

    Raises:
        InputError: an Algorithm 2 that asks for what makes no difference.
    """
    variant = MethodName.of(name).variant
    if variant in MEANS:
        return Fusion(code_of(variant, "c", mcemvs)), f"{MEANS[variant].words} across cameras"
    if camera := re.fullmatch(r"cam(0|[1-9]\d*)", variant):
        return Fusion(fusion_kernels.CAMERA + int(camera[1])), f"camera {camera[1]} alone"
    match = _COMPOSED.fullmatch(variant)
    if match is None:
        return None, ""
    _check(name, match)
    return _composed(match, mcemvs)


def code_of(mean: str, axis: str, mcemvs: bool) -> int:
    """The code of a mean across cameras (`c`) or over time (`t`)."""
    if mcemvs and mean == "H" and axis == "c":
        return fusion_kernels.HARMONIC_EPS
    return MEANS[mean].code


def _composed(match: re.Match[str], mcemvs: bool) -> tuple[Fusion, str]:
    outer, outer_axis, inner, inner_axis, digits, by_time, shuffle = match.groups()
    split = Split(int(digits), "time" if by_time else "count")
    fusion = Fusion(
        code_of(inner, inner_axis, mcemvs),
        split,
        outer=code_of(outer, outer_axis, mcemvs),
        time_first=inner_axis == "t",
        shuffled=shuffle is not None,
    )
    return fusion, (
        f"{digits} sub-intervals of equal {split.by}{', shuffled' if shuffle else ''}; fused "
        f"{_AXIS[inner_axis]} by the {MEANS[inner].words}, then {_AXIS[outer_axis]} by the "
        f"{MEANS[outer].words}"
    )


def _check(name: str, match: re.Match[str]) -> None:
    outer_axis, inner_axis, count, shuffled = match[2], match[4], int(match[5]), bool(match[7])
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
