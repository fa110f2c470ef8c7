"""How a method is drawn in every plot and table: told apart by colour, and without colour, too.

A family of methods has a marker of its own, a fusion function a dash of its own; colour says both
once more. Within a family that uses one colour the dash alone tells the members apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar
from zlib import crc32

from emvs.dsi.method import MethodName

INK = "#010203"
"""The colour of text. Matplotlib knows no `currentColor`, so it is renamed afterwards."""

Dash = str | tuple[int, tuple[int, ...]]
_Choice = TypeVar("_Choice")


@dataclass(frozen=True, slots=True)
class LineStyle:
    """A line, as matplotlib takes it.

    Attributes:
        colour: of line and marker.
        dash: of the line.
        marker: on some of its points; empty for none.
    """

    colour: str
    dash: Dash
    marker: str = ""

    @property
    def css(self) -> str:
        """The colour as a page says it: the ink follows light and dark."""
        return "currentColor" if self.colour == INK else self.colour


_DASHES: dict[str, Dash] = {
    "min": (0, (4, 1, 1, 1)),
    "H": "solid",
    "G": (0, (6, 2)),
    "A": (0, (3, 2)),
    "RMS": (0, (6, 1, 1, 1, 1, 1)),
    "max": (0, (1, 1)),
}
_CAMERA_DASHES: tuple[Dash, ...] = ((0, (10, 2)), (0, (2, 2)), (0, (1, 2)))
_LOOSE: tuple[Dash, ...] = (
    (0, (8, 2, 2, 2)), (0, (8, 2)), (0, (2, 1)), (0, (5, 1, 1, 1)), (0, (9, 1, 3, 1)),
)  # fmt: skip
# Okabe and Ito's colours, of about equal weight on white and on black.
_FUSION_COLOURS = {
    "min": "#cc79a7",
    "H": "#d55e00",
    "G": "#e69f00",
    "A": "#009e73",
    "RMS": "#0072b2",
    "max": "#56b4e9",
}
_FAMILIES = {  # colour and marker
    "Alg1": ("", ""),
    "EMVS": ("#8c8c8c", "|"),
    "Focus": (INK, "o"),
    "Alg2": ("#8f63b8", "s"),
    "Late": ("#a6761d", "D"),
    "SGM": ("#44aa99", "^"),
    "ESVO": ("#999933", "v"),
    "GTS": ("#cc6677", "X"),
    "Frames": ("#6699cc", "P"),
}
_OTHERS = ("#c2185b", "#5c6bc0", "#6a994e", "#8d6e63", "#00838f")
_OTHER_MARKERS = ("*", "p", "<", ">")
_KNOWN: dict[str, Dash] = {
    "Late/union": "solid",
    "SGM/ts": "solid",
    "SGM/window": (0, (4, 2)),
    "ESVO/own-rate": "solid",
    "ESVO/window": (0, (4, 2)),
    "GTS/events": "solid",
    "Frames/sgm": "solid",
}


def line_style(method: str) -> LineStyle:
    """The style of a method, the same wherever it is drawn; names nobody knows get one, too."""
    name = MethodName.of(method)
    others = _pick(_OTHERS, method, "colour"), _pick(_OTHER_MARKERS, method, "marker")
    colour, marker = _FAMILIES.get(name.family, others)
    colour = colour or _FUSION_COLOURS.get(name.variant, _OTHERS[0])
    return LineStyle(colour, _dash(method, name), marker)


def _dash(method: str, name: MethodName) -> Dash:
    if name.camera is not None:
        return _CAMERA_DASHES[name.camera % len(_CAMERA_DASHES)]
    return _KNOWN.get(method) or _DASHES.get(name.variant) or _pick(_LOOSE, method, "dash")


def _pick(choices: tuple[_Choice, ...], method: str, what: str) -> _Choice:
    """One of some, by the name alone: whatever else is drawn, the method looks the same."""
    return choices[crc32(f"{what} of {method}".encode()) % len(choices)]
