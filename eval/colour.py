"""Colour scales: what a value looks like, the same in every picture of a case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from numpy.typing import NDArray

BLANK = 255  # palette row of pixels that hold no value
_LEVELS = 255
_NICE = (1.0, 2.0, 5.0, 3.0, 4.0, 1.5, 8.0, 6.0, 2.5)  # in order of preference


@dataclass(frozen=True, slots=True)
class Scale:
    """A palette of 255 colours between two values, and where to write numbers beside it.

    Attributes:
        low: value of the first colour.
        high: value of the last colour.
        palette: (256, 4) uint8 colours; the last row is the blank.
        ticks: (position in 0..1, label) along the bar.
        label: quantity and unit.
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
        rows = np.linspace(0, _LEVELS - 1, 24).round().astype(int)
        stops = ", ".join("#{:02x}{:02x}{:02x}".format(*self.palette[row, :3]) for row in rows)
        return f"linear-gradient(to right, {stops})"


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
    return Scale(-cap, cap, _sampled(blend, 0.0, 1.0), ticks, "events")


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


def _palette(name: str, low: float, high: float) -> NDArray[np.uint8]:
    return _sampled(mpl.colormaps[name], low, high)


def _sampled(colormap: mpl.colors.Colormap, low: float, high: float) -> NDArray[np.uint8]:
    colours = np.rint(255 * colormap(np.linspace(low, high, _LEVELS))).astype(np.uint8)
    blank = np.full((1, 4), 255, np.uint8)
    return np.concatenate([colours, blank])
