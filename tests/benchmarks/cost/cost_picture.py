"""The picture of `docs/performance.md`: cost over what it grows with."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from cost_growth import Growth, Load
from eventsweep.emvs.utils.files import atomic_path

_POINT, _LINE = "#0072b2", "#d55e00"
_AXIS = {
    "events": "events per camera", "planes": "planes", "pixels": "pixels per camera",
    "cameras": "cameras", "windows": "windows",
}  # fmt: skip


def draw(grown: Sequence[Growth], base: Load, path: Path) -> None:
    """Draws one log-log panel per quantity, all with one time axis, as a PNG."""
    figure = Figure(figsize=(3.0 * len(grown), 3.2), layout="constrained", dpi=100)
    panels = np.atleast_1d(np.array(figure.subplots(1, len(grown), sharey=True)))
    for axes, one in zip(panels, grown, strict=True):
        _panel(axes, one, getattr(base, one.quantity))
    panels[0].set_ylabel("processor time, one thread (s)")
    with atomic_path(path) as partial, partial.open("wb") as file:
        figure.savefig(file, format="png")


def _panel(axes: Axes, one: Growth, base: int) -> None:
    slope, intercept = one.line
    ends = np.array([min(one.amounts), max(one.amounts)], float)
    axes.plot(ends, np.exp(intercept) * ends**slope, color=_LINE, linewidth=1.5)
    axes.plot(one.amounts, one.seconds, "o", color=_POINT, markersize=6)
    here = one.seconds[one.amounts.index(base)]
    axes.plot(base, here, "o", color=_POINT, markersize=11, fillstyle="none")
    axes.set(xscale="log", yscale="log", xlabel=_AXIS[one.quantity])
    axes.set_title(f"time ∝ {one.quantity}$^{{\\,{slope:.2f}}}$", fontsize=11)
    if max(one.amounts) < 1000:
        axes.set_xticks(one.amounts, [str(amount) for amount in one.amounts])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3)
