"""The page of a tracked recording: its path and map from above and from the side, its status."""

from __future__ import annotations

import io

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eventsweep.emvs.depth.point_cloud import PointCloud
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.figures.plots import ESTIMATE_COLOUR, STYLE, svg
from eventsweep.eval.report.html import (
    Grid,
    GridCell,
    Head,
    Moving,
    Page,
    Plot,
    Section,
    Text,
    grid,
    made_here,
    page_text,
    plural,
)
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import Tracked

_MOST_POINTS = 4000  # of the map, drawn
_MOST_STEPS = 200  # of the slider
_VIEWS = (("from above", 0, 2), ("from the side", 2, 1))
_COLOURS = {
    Status.TRACKING: "#009e73",
    Status.UNCERTAIN: "#cc79a7",
    Status.STILL: "#56b4e9",
    Status.COASTING: "#e69f00",
    Status.LOST: "#d55e00",
    Status.STARTING: "#999999",
}


def track_page(name: str, tracked: Tracked, cloud: PointCloud) -> str:
    """The page as HTML."""
    lost = sum(change.status is Status.LOST for change in tracked.changes)
    uncertain = sum(status is Status.UNCERTAIN for status in tracked.statuses)
    first_us, last_us = tracked.span_us
    figure = _overview(tracked, cloud)
    text = Text(
        "Axes are those of the first pose's world: for a body that looks ahead x points right, y "
        "down, z forward. Grey: points of the maps. Colours below: status. Move the slider, or "
        "play."
    )
    about = "path and map from above and from the side; position and status over time"
    plot = Plot(svg(lambda: figure), about, _moving(tracked, figure))
    page = Page(
        title=f"{name}, tracked",
        subtitle=f"{len(tracked.trajectory):,} poses over {(last_us - first_us) / 1e6:.2f} s, "
        f"{100 * tracked.covered:.1f} % of the time covered, {plural(tracked.maps, 'map')}, "
        + (f"lost {plural(lost, 'time')}" if lost else "never lost")
        + (f", {plural(uncertain, 'pose')} uncertain" if uncertain else ""),
        sections=(
            Section("path", "Path", (text, plot, _changes(tracked))),
            Section("status", "Status", (_counts(tracked),)),
            made_here(),
        ),
        files=("trajectory.txt", "track.json", "cloud.ply"),
    )
    return page_text(page)


def _changes(tracked: Tracked) -> Grid:
    first_us = tracked.span_us[0]
    lines = (
        (GridCell(f"{(c.t_us - first_us) / 1e6:.3f}", c.t_us), c.status.value, c.reason)
        for c in tracked.changes
    )
    return grid((Head("time", "s"), "status", "reason"), lines)


def _counts(tracked: Tracked) -> Grid:
    counts = {status: sum(each is status for each in tracked.statuses) for status in Status}
    lines = ((status.value, count) for status, count in counts.items() if count)
    return grid(("status", Head("poses", direction="higher")), lines)


def _overview(tracked: Tracked, cloud: PointCloud) -> Figure:
    """Path and map from above and from the side; below, position and status over time."""
    with mpl.rc_context(STYLE):
        figure = LaidOutFigure(figsize=(10.5, 6.8))
        grid = figure.add_gridspec(2, 2, height_ratios=(4.4, 2.4))
        for k, view in enumerate(_VIEWS):
            _draw_path(figure.add_subplot(grid[0, k]), tracked, cloud, *view)
        figure.axes[1].invert_yaxis()
        _draw_over_time(figure.add_subplot(grid[1, :]), tracked)
        figure.legend(loc="outside lower right", ncols=8)
        figure.savefig(io.BytesIO(), format="svg")  # finds the layout
    return figure


def _draw_path(
    axes: Axes, tracked: Tracked, cloud: PointCloud, title: str, across: int, up: int
) -> None:
    step = max(1, len(cloud) // _MOST_POINTS)
    points, places = cloud.points_world[::step], tracked.trajectory.positions_m
    axes.plot(points[:, across], points[:, up], ".", ms=1, color="#999999", rasterized=True)
    axes.plot(places[:, across], places[:, up], lw=1.6, color=ESTIMATE_COLOUR)
    axes.plot(*places[0, [across, up]], "o", ms=4, color=ESTIMATE_COLOUR)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(title, fontsize=10, loc="left")
    axes.set(xlabel=f"{'xyz'[across]} [m]", ylabel=f"{'xyz'[up]} [m]")
    axes.grid(linewidth=0.4, alpha=0.35)


def _draw_over_time(axes: Axes, tracked: Tracked) -> None:
    first_us, last_us = tracked.span_us
    t_s = (tracked.trajectory.t_us - first_us) / 1e6
    for k, (name, dash) in enumerate((("x", "-"), ("y", "--"), ("z", ":"))):
        axes.plot(t_s, tracked.trajectory.positions_m[:, k], dash, lw=1.3, label=name)
    _shade(axes, tracked, (last_us - first_us) / 1e6)
    axes.set(xlabel="time [s]", ylabel="position [m]")
    axes.grid(linewidth=0.4, alpha=0.35)


def _moving(tracked: Tracked, figure: Figure) -> Moving:
    """Where the body is at each step of the slider, on all panels."""
    count = len(tracked.trajectory)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST_STEPS)).astype(int))
    t_s = (tracked.trajectory.t_us[chosen] - tracked.span_us[0]) / 1e6
    places = tracked.trajectory.positions_m[chosen]
    *views, over_time = figure.axes
    dots = tuple(
        _shares(figure, axes, places[:, [across, up]])
        for axes, (_, across, up) in zip(views, _VIEWS, strict=True)
    )
    line = _shares(figure, over_time, np.column_stack([t_s, np.zeros_like(t_s)]))
    names = tuple(
        f"{time:.2f} s, {tracked.statuses[k].value}" for time, k in zip(t_s, chosen, strict=True)
    )
    box = over_time.get_position()
    return Moving(names, dots, tuple(x for x, _ in line), (1 - box.y1, 1 - box.y0))


def _shares(
    figure: Figure, axes: Axes, points: NDArray[np.float64]
) -> tuple[tuple[float, float], ...]:
    """(N, 2) points of a panel as shares of the figure's width, and of its height from the top."""
    places = figure.transFigure.inverted().transform(axes.transData.transform(points))
    return tuple((round(float(x), 4), round(1 - float(y), 4)) for x, y in places)


def _shade(axes: Axes, tracked: Tracked, end_s: float) -> None:
    first_us = tracked.span_us[0]
    begins_s = [(change.t_us - first_us) / 1e6 for change in tracked.changes]
    named: set[Status] = set()
    for change, begin, end in zip(
        tracked.changes, begins_s, np.r_[begins_s[1:], end_s], strict=True
    ):
        label = None if change.status in named else change.status.value
        named.add(change.status)
        axes.axvspan(
            begin, float(end), color=_COLOURS[change.status], alpha=0.18, lw=0, label=label
        )
