"""Colour maps of pictures, and how a method is drawn in every plot and table.

A family of methods has a marker of its own, a fusion function a dash of its own; colour says both
once more. Within a family that uses one colour the dash alone tells the members apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar
from zlib import crc32

import matplotlib as mpl
import numpy as np
from matplotlib.colors import Colormap, LinearSegmentedColormap
from numpy.typing import NDArray

from eventsweep.emvs.dsi.method import MethodName

BLANK = 255  # palette row of pixels that hold no value
_LEVELS = 255
_NICE = (1.0, 2.0, 5.0, 3.0, 4.0, 1.5, 8.0, 6.0, 2.5)  # in order of preference
INK = "#010203"
"""The colour of text. Matplotlib knows no `currentColor`, so it is renamed afterwards."""
Dash = str | tuple[int, tuple[int, ...]]
_Choice = TypeVar("_Choice")


@dataclass(frozen=True, slots=True)
class Scale:
    """A palette of 255 colours between two values, and where to write numbers beside it.

    Attributes:
        palette: (256, 4) uint8 colours; the last row is the blank.
        ticks: (position in 0..1, label) along the bar.
    """

    low: float
    high: float
    palette: NDArray[np.uint8]
    ticks: tuple[tuple[float, str], ...]
    label: str

    def index(self, values: NDArray[np.floating], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """(H, W) palette rows of values, clipped to the scale; blank outside the mask."""
        share = (np.where(mask, values, self.low) - self.low) / (self.high - self.low)
        level = np.rint(np.clip(share, 0, 1) * (_LEVELS - 1))
        return np.where(mask, level, BLANK).astype(np.uint8)

    def css_gradient(self) -> str:
        """The scale's colours from low to high, as a CSS gradient."""
        return f"linear-gradient(to right, {', '.join(self.css_colours(24))})"

    def css_colours(self, count: int) -> list[str]:
        """So many of the scale's colours from low to high, as CSS."""
        rows = np.linspace(0, _LEVELS - 1, count).round().astype(int)
        return ["#{:02x}{:02x}{:02x}".format(*self.palette[row, :3]) for row in rows]


def depth_scale(depth_range_m: tuple[float, float]) -> Scale:
    """Blue (far) to red (near), even in inverse depth, as in the figures of the EMVS papers."""
    near_m, far_m = depth_range_m
    low, high = 1 / far_m, 1 / near_m
    marks = [(1 / depth_m - low) / (high - low) for depth_m in nice_between(near_m, far_m)]
    labels = [f"{depth_m:g}" for depth_m in nice_between(near_m, far_m)]
    ends = [(0.0, f"{far_m:g}"), (1.0, f"{near_m:g}")]
    ticks = spaced(ends + list(zip(marks, labels, strict=True)))
    return Scale(low, high, _palette("turbo", 0.05, 0.95), ticks, "depth [m]")


def error_scale(cap_cm: float) -> Scale:
    """Blue (none) to orange (`cap_cm` and more): even to the eye, safe for the colour-blind."""
    parts = next((n for n in (4, 5, 3) if _is_round(cap_cm / n)), 2)
    ticks = [(k / parts, f"{cap_cm * k / parts:g}") for k in range(parts)]
    ticks.append((1.0, f"≥ {cap_cm:g}"))
    palette = _palette("plasma", 0.0, 0.88)
    palette[BLANK, 3] = 0  # the frame shows through
    return Scale(0.0, cap_cm, palette, tuple(ticks), "|error| [cm]")


def confidence_scale(high: float) -> Scale:
    """White (no votes) to black (`high` and more)."""
    top = high if high > 0 else 1.0
    ticks = [(0.0, "0"), (0.5, f"{top / 2:.3g}"), (1.0, f"≥ {top:.3g}")]
    return Scale(0.0, top, _palette("Greys", 0.0, 1.0), tuple(ticks), "votes")


def events_scale(cap: int) -> Scale:
    """Orange (darker) over white to blue (brighter), by events per pixel."""
    colours = ["#b35806", "#f1a340", "#ffffff", "#67a9cf", "#0b4f9c"]
    blend = LinearSegmentedColormap.from_list("polarity", colours, N=_LEVELS)
    ticks = ((0.0, f"≥ {cap} darker"), (0.5, "0"), (1.0, f"≥ {cap} brighter"))
    return Scale(-cap, cap, _palette(blend, 0.0, 1.0), ticks, "events")


def grey_palette() -> NDArray[np.uint8]:
    """(256, 4) black to white, opaque."""
    grey = np.arange(256, dtype=np.uint8)
    return np.stack([grey, grey, grey, np.full(256, 255, np.uint8)], axis=1)


def nice_between(low: float, high: float) -> list[float]:
    """Round values strictly between two positive ones, the roundest first."""
    exponents = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    values = (round(nice * 10.0**exponent, 9) for nice in _NICE for exponent in exponents)
    return [value for value in values if low < value < high]


def nice_above(value: float) -> float:
    """The next round value, at least `value` (which is positive)."""
    exponent = int(np.floor(np.log10(value)))
    steps = (round(nice * 10.0**power, 9) for power in (exponent, exponent + 1) for nice in _NICE)
    return min(step for step in steps if step >= value)


def spaced(ticks: Sequence[tuple[float, str]], gap: float = 0.11) -> tuple[tuple[float, str], ...]:
    """Keeps ticks in order of preference, as long as they lie `gap` apart; sorts them."""
    kept: list[tuple[float, str]] = []
    for tick in ticks:
        if all(abs(tick[0] - other[0]) >= gap for other in kept):
            kept.append(tick)
    return tuple(sorted(kept))


def _is_round(value: float) -> bool:
    return f"{value:e}"[:4] in ("1.00", "2.00", "5.00")


def _palette(colormap: str | Colormap, low: float, high: float) -> NDArray[np.uint8]:
    sampled = mpl.colormaps.get_cmap(colormap)(np.linspace(low, high, _LEVELS))
    colours = np.rint(255 * sampled).astype(np.uint8)
    blank = np.full((1, 4), 255, np.uint8)
    return np.concatenate([colours, blank])


@dataclass(frozen=True, slots=True)
class LineStyle:
    """A line, as matplotlib takes it."""

    colour: str
    dash: Dash
    marker: str = ""

    @property
    def css(self) -> str:
        """The colour as a page says it: the ink follows light and dark."""
        return "currentColor" if self.colour == INK else self.colour


_DASHES: dict[str, Dash] = {
    "min": (0, (4, 1, 1, 1)), "H": "solid", "G": (0, (6, 2)), "A": (0, (3, 2)),
    "RMS": (0, (6, 1, 1, 1, 1, 1)), "max": (0, (1, 1)),
}  # fmt: skip
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
    "Learned": ("#882255", "h"),
    "DERD": ("#117733", "d"),
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
    "Late/union": "solid", "SGM/ts": "solid", "SGM/window": (0, (4, 2)), "ESVO/own-rate": "solid",
    "ESVO/window": (0, (4, 2)), "GTS/events": "solid", "Frames/sgm": "solid",
}  # fmt: skip


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
