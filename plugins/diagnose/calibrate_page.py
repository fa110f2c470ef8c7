"""The page of a refined calibration: what changed, how sure it is, a window before and after."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import starmap
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eventsweep.emvs.data.recording import Recording
from eventsweep.eval.figures.colormaps import Scale, depth_scale
from eventsweep.eval.figures.images import depth_image, point_size_px
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.figures.plots import ESTIMATE_COLOUR, TRUTH_COLOUR, slice_figure, svg
from eventsweep.eval.numbers import shown_zero_us
from eventsweep.eval.report.html import (
    Block,
    Columns,
    Grid,
    GridCell,
    Head,
    Layer,
    Page,
    Picture,
    Pictures,
    Plot,
    Section,
    Sentences,
    Text,
    files_in,
    grid,
    made_here,
    page_text,
    plural,
)
from eventsweep.eval.report.run_data import slice_of
from eventsweep.plugins.diagnose.calibrate.before_after import MappedWith
from eventsweep.plugins.diagnose.calibrate.refine import Estimate, Refinement

_ROWS_PX = 5.0


def summary(refinement: Refinement) -> str:
    """How many parameters were refined, and how many refused."""
    refused = sum(bool(estimate.refused) for estimate in refinement.estimates)
    return f"{len(refinement.estimates) - refused} refined, {refused} refused"


def calibration_page(
    recording: Recording, refinement: Refinement, sides: Sequence[MappedWith], notes: Sequence[str],
    command: str, folder: Path,
) -> str:  # fmt: skip
    """The page as HTML."""
    files = [file.name for file in sorted(folder.iterdir()) if file.suffix != ".html"]
    page = Page(
        title=f"Calibration of {recording.name}",
        subtitle="",
        blocks=(Sentences(tuple(sentences(refinement, sides))),),
        sections=(*_sections(refinement, sides, notes), made_here(command)),
        files=files_in(folder, files),
    )
    return page_text(page)


def _sections(
    refinement: Refinement, sides: Sequence[MappedWith], notes: Sequence[str]
) -> Iterator[Section]:
    rho = sides[0].mapped.view.rho
    scale = depth_scale((1 / float(rho.max()), 1 / float(rho.min())))
    text = Text(
        "The window that gains most, mapped with both calibrations: depth, and a row of the DSI "
        "seen from above."
    )
    shown = Columns(tuple(_side(side, scale) for side in sides))
    yield Section("window", "Before and after", (text, shown))
    text = Text(
        "A correction is what was added to the calibration as given. The uncertainty is that of "
        "95 %, from how flat the top of the sharpness is and how windows differ. What is refused "
        "keeps its value."
    )
    said = Sentences(tuple(notes), "note")
    yield Section("estimates", "Corrections", (text, estimates_grid(refinement.estimates), said))
    if refinement.curves:
        text = Text(
            "All other parameters at their best. The band is the uncertainty; the dotted line is "
            "the calibration as given."
        )
        plot = Plot(svg(_curves, refinement), "sharpness per parameter")
        blocks = text, plot, windows_grid(refinement)
        yield Section("curves", "Sharpness over each parameter", blocks)
    if len(sides[0].residuals_px):
        text = Text(
            "A measure that refinement does not use: patches of camera 0's events, matched in "
            "camera 1's rectified view."
        )
        plot = Plot(svg(_residuals, sides), "histogram of the residuals")
        yield Section("epipolar", "Epipolar residuals", (text, plot))


def _side(side: MappedWith, scale: Scale) -> tuple[Block, ...]:
    depth = side.mapped.depth_maps[side.method]
    about = f"{int(depth.mask.sum()):,} points, {side.method}"
    point_px = point_size_px(depth.depth_m.shape[1])
    image = depth_image(depth.depth_m, depth.mask, scale, point_px)
    picture = Picture("Depth [m]", (Layer(image.data_uri(), about),), scale)
    drawn = svg(slice_figure, slice_of(depth, side.mapped.slices))
    return (
        Text(side.name, "heading"),
        Pictures((picture,), columns=1),
        Plot(drawn, f"slice of the DSI, {side.name}"),
    )


def sentences(refinement: Refinement, sides: Sequence[MappedWith]) -> list[str]:
    """What the page says first."""
    before, after = refinement.sharpness.mean(axis=0)
    gain = 100 * (after / before - 1)
    windows = plural(len(refinement.windows), "window")
    sharper = f"{gain:.1f} % sharper" if gain >= 0.05 else "as sharp as before"
    lines = [f"{summary(refinement)}; the DSI of {windows} is {sharper}."]
    refined = [estimate for estimate in refinement.estimates if not estimate.refused]
    if refined and all(abs(estimate.value) <= estimate.uncertainty for estimate in refined):
        lines.append("No correction exceeds its uncertainty: the given calibration was right.")
    if all(len(side.residuals_px) for side in sides):
        values = [float(np.median(np.abs(side.residuals_px))) for side in sides]
        lines.append(
            f"Matched patches lie {values[0]:.2f} rows off their epipolar lines (median) with "
            f"the calibration as given, {values[1]:.2f} with the refined one."
        )
    return lines


def estimates_grid(estimates: Sequence[Estimate]) -> Grid:
    """A line per parameter: correction, uncertainty, verdict."""
    heads = ("parameter", Head("correction"), Head("±", "95 %"), "unit", "result")
    return grid(heads, map(_line, estimates))


def _line(estimate: Estimate) -> tuple[object, ...]:
    value, uncertainty, refused = estimate.value, estimate.uncertainty, estimate.refused
    return (
        estimate.parameter.name,
        GridCell("as given" if refused else f"{value:+.3f}", value),
        GridCell(f"{uncertainty:.3f}" if math.isfinite(uncertainty) else "unknown", uncertainty),
        estimate.parameter.unit,
        GridCell(f"refused: {refused}" if refused else "refined",
                 kind="worse" if refused else "better"),
    )  # fmt: skip


def windows_grid(refinement: Refinement) -> Grid:
    """A line per window: its time and its sharpness before and after.

    Times of a clock are those since the first window's begin.
    """
    units = {"window": "s", "as given": "votes", "refined": "votes", "gain": "%"}
    lines, zero_us = [], shown_zero_us(min((t0_us for t0_us, _ in refinement.windows), default=0))
    for (t0_us, t1_us), (before, after) in zip(
        refinement.windows, refinement.sharpness, strict=True
    ):
        gain = 100 * (after / before - 1)
        times = f"{(t0_us - zero_us) / 1e6:.3f} to {(t1_us - zero_us) / 1e6:.3f}"
        cells = (GridCell(times, t0_us), GridCell(f"{before:.2f}", before),
                 GridCell(f"{after:.2f}", after), GridCell(f"{gain:+.1f}", gain))  # fmt: skip
        lines.append(cells)
    return grid(starmap(Head, units.items()), lines)


def _curves(refinement: Refinement) -> Figure:
    names = list(refinement.curves)
    columns = min(4, len(names))
    rows = -(-len(names) // columns)
    figure = LaidOutFigure(figsize=(10.5, 0.4 + 2.1 * rows))
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    by_name = {estimate.parameter.name: estimate for estimate in refinement.estimates}
    for axes, name in zip(panels, names, strict=False):
        _draw_curve(axes, by_name[name], *refinement.curves[name])
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    return figure


def _draw_curve(axes: Any, estimate: Estimate, at: Any, relative: Any) -> None:
    value, uncertainty = estimate.value, estimate.uncertainty
    axes.plot(at, 100 * relative, lw=1.4, color=TRUTH_COLOUR, marker="o", ms=2.5)
    axes.axvline(0, color="#888888", lw=0.8, ls=":")
    axes.axvspan(value - uncertainty, value + uncertainty, color=ESTIMATE_COLOUR, alpha=0.2, lw=0)
    axes.axvline(value, color=ESTIMATE_COLOUR, lw=1)
    axes.set_title(estimate.parameter.name, fontsize=9, loc="left")
    axes.set(xlabel=f"correction [{estimate.parameter.unit}]", ylabel="sharpness [%]")
    axes.grid(linewidth=0.4, alpha=0.35)


def _residuals(sides: Sequence[MappedWith]) -> Figure:
    figure = LaidOutFigure(figsize=(10.5, 2.4))
    axes = figure.subplots()
    bins = np.linspace(-_ROWS_PX, _ROWS_PX, 51).tolist()
    for side, colour in zip(sides, ("#888888", ESTIMATE_COLOUR), strict=True):
        share = 100 * np.ones(len(side.residuals_px)) / max(1, len(side.residuals_px))
        axes.hist(side.residuals_px, bins, weights=share, histtype="stepfilled", alpha=0.55,
                  color=colour, label=side.name)  # fmt: skip
    axes.set_xlabel("rows between a patch of camera 0 and its match in camera 1 [px]")
    axes.set_ylabel("share of patches [%]")
    axes.grid(linewidth=0.4, alpha=0.35)
    figure.legend(loc="outside upper right", ncols=2)
    return figure
