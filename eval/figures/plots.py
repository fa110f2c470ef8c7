"""Plots with axes, as SVG that takes the colour of the text around it."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from eventsweep.eval.figures.colormaps import INK, line_style, nice_between, spaced
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.results.table import each
from eventsweep.eval.scoring.curves import THRESHOLDS_CM
from eventsweep.eval.scoring.method_scores import CAUSE_PREFIX
from eventsweep.eval.scoring.outlier_causes import CAUSES

STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "eventsweep",
    "font.family": "sans-serif",
    "font.size": 9,
    "text.parse_math": False,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.linewidth": 0.6,
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
}
SharesByName = Mapping[str, NDArray[np.float64]]
TRUTH_COLOUR = "#0072b2"
ESTIMATE_COLOUR = "#d55e00"
# Okabe and Ito's colours in the order of the causes, black replaced: it has no place on dark.
CAUSE_COLOURS = dict(
    zip(
        CAUSES,
        ("#999999", "#cc79a7", "#0072b2", "#d55e00", "#e69f00", "#56b4e9", "#009e73", "#f0e442"),
        strict=True,
    )
)
_BAR_INCHES = 0.27


def svg(draw: Callable[..., Figure], *content: Any) -> Markup:
    """What `draw` makes of its content within `STYLE`, as SVG to put into a page.

    It has the colour of the text around it.
    """
    stream = io.StringIO()
    with mpl.rc_context(STYLE):
        draw(*content).savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    drawing = stream.getvalue()
    drawing = drawing[drawing.index("<svg") :].replace(INK, "currentColor")
    # The page's style sets the size; a fixed one would overflow a phone.
    opening, rest = drawing.split(">", 1)
    return Markup(re.sub(r' (?:width|height)="[^"]*"', "", opening) + ">" + rest)


def plain_ticks(*scales: Axis) -> None:
    """Numbers instead of powers of ten at the decades of logarithmic axes, and none between."""
    for axis in scales:
        axis.set_major_formatter(lambda value, _: f"{value:,.0f}" if value >= 1 else f"{value:g}")
        axis.set_minor_formatter(NullFormatter())


def curves_figure(curves: Sequence[tuple[str, SharesByName]], prefix: str) -> Figure:
    """Precision, recall and F1 of several methods against the tolerated error.

    Each has (15,) shares in % by those names, at `THRESHOLDS_CM`. Lines have the ids
    `{prefix}-{share}-curve-{position}`.
    """
    figure = LaidOutFigure(figsize=(10.5, 3.3))
    panels = figure.subplots(1, 3)
    for axes, name in zip(panels, ("precision", "recall", "f1"), strict=True):
        _draw_curves(axes, curves, name, prefix)
    handles = panels[0].get_lines()
    figure.legend(handles=handles, loc="outside right center", handlelength=3.2)
    return figure


def _draw_curves(
    axes: Axes, curves: Sequence[tuple[str, SharesByName]], name: str, prefix: str
) -> None:
    for position, (method, curve) in enumerate(curves):
        style = line_style(method)
        (line,) = axes.plot(
            THRESHOLDS_CM, curve[name], color=style.colour, linestyle=style.dash, linewidth=1.4,
            marker=style.marker, markersize=4.5, markevery=(position % 4, 4), label=method,
        )  # fmt: skip
        line.set_gid(f"{prefix}-{name}-curve-{position}")
    axes.set_title({"f1": "F1"}.get(name, name), fontsize=10, loc="left")
    axes.set(xlabel="tolerated error [cm]", ylabel="share [%]")
    axes.set_xlim(1, 15)
    axes.set_ylim(bottom=0)
    axes.set_xticks([1, 5, 10, 15])
    axes.grid(linewidth=0.4, alpha=0.35)


@dataclass(frozen=True, slots=True)
class DsiSlice:
    """One image row of a fused DSI, and what was read from it.

    Attributes:
        row_px: which row.
        rho: (N,) inverse depths of the planes, 1/m, near to far or far to near.
        votes: (N, W) fused ray density.
        depth_m: (W,) extracted depth, m.
        mask: (W,) where there is one.
        truth_m: (W,) true depth, m, NaN where unknown; None without ground truth.
    """

    row_px: int
    rho: NDArray[np.floating]
    votes: NDArray[np.floating]
    depth_m: NDArray[np.floating]
    mask: NDArray[np.bool_]
    truth_m: NDArray[np.floating] | None = None


class SliceFigures:
    """Draws the slices of one window: same row, planes and truth, so their layout is found once."""

    def __init__(self) -> None:
        self._first: Figure | None = None

    def __call__(self, dsi_slice: DsiSlice) -> Figure:
        """See `slice_figure`."""
        figure = slice_figure(dsi_slice, self._first)
        self._first = self._first or figure
        return figure


def slice_figure(dsi_slice: DsiSlice, like: Figure | None = None) -> Figure:
    """Seen from above, the camera below: ray density, extracted depth and true depth of one row.

    Its layout is that of a slice `like` it, where there is one.
    """
    figure = LaidOutFigure(like, figsize=(10.5, 3.6))
    axes = figure.subplots()
    _draw_votes(axes, dsi_slice)
    columns = np.flatnonzero(dsi_slice.mask)
    if dsi_slice.truth_m is not None:
        axes.plot(
            *_surfaces(dsi_slice.truth_m, dsi_slice.rho),
            lw=1.6,
            color=TRUTH_COLOUR,
            label="true depth",
        )
    axes.plot(
        columns, 1 / dsi_slice.depth_m[columns], "o", ms=3.6, mfc="none", mew=1.1,
        color=ESTIMATE_COLOUR, label="extracted depth",
    )  # fmt: skip
    axes.set_ylim(float(dsi_slice.rho.max()), float(dsi_slice.rho.min()))
    figure.legend(loc="outside upper right", ncols=2, markerscale=1.8)
    return figure


def _surfaces(
    truth_m: NDArray[np.floating], planes: NDArray[np.floating]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Column and true inverse depth as a line that is interrupted where depth jumps.

    One path; a mark for each pixel would be most of the picture's file.
    """
    x_px, rho = np.arange(len(truth_m), dtype=np.float64), 1 / truth_m
    cell = float(planes.max() - planes.min()) / (len(planes) - 1)
    # Half a pixel to either side of each column, so that single pixels show, too.
    jumps = np.flatnonzero(~(np.abs(np.diff(rho)) <= cell)) + 1
    x_px, rho = np.repeat(x_px, 2), np.repeat(rho, 2)
    x_px[::2] -= 0.5
    x_px[1::2] += 0.5
    return np.insert(x_px, 2 * jumps, np.nan), np.insert(rho, 2 * jumps, np.nan)


def _draw_votes(axes: Axes, dsi_slice: DsiSlice) -> None:
    votes = dsi_slice.votes[np.argsort(dsi_slice.rho)]
    low, high = float(dsi_slice.rho.min()), float(dsi_slice.rho.max())
    half = (high - low) / (len(dsi_slice.rho) - 1) / 2
    top = float(np.percentile(votes, 99.7)) or 1.0
    axes.imshow(
        votes,
        cmap="Greys",
        vmin=0,
        vmax=top,
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        extent=(-0.5, votes.shape[1] - 0.5, low - half, high + half),
    )
    marks = [((rho - low) / (high - low), f"{1 / rho:.3g}") for rho in (high, low)]
    marks += [((1 / z - low) / (high - low), f"{z:g}") for z in nice_between(1 / high, 1 / low)]
    ticks = spaced(marks, gap=0.09)
    axes.set_yticks([low + share * (high - low) for share, _ in ticks], [name for _, name in ticks])
    axes.set(xlabel=f"x [px], image row {dsi_slice.row_px}", ylabel="depth [m], even in 1/depth")


def outlier_causes(
    rows: pd.DataFrame, methods: Sequence[str]
) -> dict[str, tuple[float, dict[str, float]]]:
    """Per method the share of outliers and the share of each cause among them, all in %.

    Of the rows of one case and window; methods without causes are left out, as is a cause that was
    not measured.
    """
    values = {(row.method, row.metric): row.value for row in each(rows)}
    found = {}
    for method in methods:
        share = values.get((method, "outlier_share"), math.nan)
        known = {c: values.get((method, CAUSE_PREFIX + c), math.nan) for c in CAUSES}
        causes = {c: value for c, value in known.items() if math.isfinite(value)}
        if math.isfinite(share) and causes:
            found[method] = (share, causes)
    return found


def causes_figure(shares: Mapping[str, tuple[float, dict[str, float]]]) -> Figure:
    """Draws what `outlier_causes` found as stacked bars."""
    figure = LaidOutFigure(figsize=(10.5, 1.1 + _BAR_INCHES * len(shares)))
    axes = figure.subplots()
    before = [0.0] * len(shares)
    for cause, colour in CAUSE_COLOURS.items():
        measured = any(cause in causes for _, causes in shares.values())
        lengths = [share * causes.get(cause, 0.0) / 100 for share, causes in shares.values()]
        axes.barh(
            list(shares), lengths, left=before, height=0.74, color=colour,
            label=cause.replace("_", " ") + (not measured) * " (not measured)",
        )  # fmt: skip
        before = [begin + length for begin, length in zip(before, lengths, strict=True)]
    axes.invert_yaxis()
    axes.set_xlabel("points with an error above 10 % of the true depth, share of all points [%]")
    axes.grid(axis="x", linewidth=0.4, alpha=0.35)
    axes.set_axisbelow(True)
    axes.tick_params(axis="y", length=0)
    figure.legend(loc="outside right center", handlelength=1.2)
    return figure
