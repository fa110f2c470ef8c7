"""Figures of a ranking: error over coverage, accuracy against cost, and over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eventsweep.eval.figures.colormaps import line_style
from eventsweep.eval.figures.laid_out import LaidOutFigure

_SIZE = (10.5, 4.6)
_MARKER = 5.5


def coverage_figure(curves: Mapping[str, Sequence[tuple[float, float]]]) -> Figure:
    """Relative error over coverage in %, both logarithmic; a method's last point has all pixels."""
    figure, axes = _axes()
    for method, curve in curves.items():
        _line(axes, method, [x for x, _ in curve], [y for _, y in curve])
    axes.set_xlabel("coverage: share of the true pixels, the surest first [%]")
    axes.set_ylabel("error, as a multiple of the median method's")
    return _finished(figure, axes)


def cost_figure(points: Mapping[str, tuple[float, float, bool]]) -> Figure:
    """Relative error in % against time for a window in s, both logarithmic.

    A point says last whether its time is only stated.
    """
    figure, axes = _axes()
    for method, (seconds, error, is_stated) in points.items():
        style = line_style(method)
        axes.plot(
            [seconds], [error], style.marker or "o", color=style.colour, label=method,
            ms=_MARKER + 2, mfc="none" if is_stated else style.colour, mew=1.4, linestyle="",
        )  # fmt: skip
    axes.set_xlabel("time for a window [s]; hollow: stated by its submitter, not measured here")
    axes.set_ylabel("relative error [%]")
    return _finished(figure, axes)


def history_figure(labels: Sequence[str], lines: Mapping[str, Sequence[float]]) -> Figure:
    """Relative error of each method over versions, logarithmic."""
    figure, axes = _axes()
    for method, line in lines.items():
        _line(axes, method, range(len(labels)), line)
    axes.set_xticks(range(len(labels)), labels)
    axes.set_ylabel("relative error [%]")
    return _finished(figure, axes, "y")


def _axes() -> tuple[Figure, Axes]:
    figure = LaidOutFigure(figsize=_SIZE)
    return figure, figure.subplots()


def _line(axes: Axes, method: str, x: Sequence[float], y: Sequence[float]) -> None:
    style = line_style(method)
    axes.plot(
        x, y, color=style.colour, linestyle=style.dash, linewidth=1.4, label=method,
        marker=style.marker or "o", markersize=_MARKER,
    )  # fmt: skip


def _finished(figure: Figure, axes: Axes, logarithmic: str = "xy") -> Figure:
    for name in logarithmic:
        # Nothing positive to show has no such scale.
        if math.isfinite(getattr(axes.dataLim, f"minpos{name}")):
            axes.set(**{f"{name}scale": "log"})
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_minor_formatter(lambda value, _: _minor(value))
    axes.grid(which="both", linewidth=0.4, alpha=0.35)
    axes.set_axisbelow(True)
    figure.legend(loc="outside right center", handlelength=3.2, fontsize=8)
    return figure


def _minor(value: float) -> str:
    digit = value / 10 ** math.floor(math.log10(value))
    return f"{value:g}" if round(digit) in (2, 5) else ""
