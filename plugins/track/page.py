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
from eventsweep.plugins.track.scored import Judged

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


def track_page(name: str, tracked: Tracked, cloud: PointCloud, score: Judged | None = None) -> str:
    """The page as HTML."""
    has_scores = score is not None and score.found is not None
    lost = sum(change.status is Status.LOST for change in tracked.changes)
    uncertain = sum(status is Status.UNCERTAIN for status in tracked.statuses)
    first_us, last_us = tracked.span_us
    figure = _overview(tracked, cloud)
    text = Text(
        "Axes are those of the first pose's world: for a body that looks ahead x points right, y "
        "down, z forward. Grey: points of the maps. Bands: two standard deviations. Move the "
        "slider, or play."
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
            *(() if score is None else (score.section(),)),
            made_here(),
        ),
        files=(
            "trajectory.txt",
            "covariances.txt",
            "track.json",
            "cloud.ply",
            *(("results.json", "results.csv") if has_scores else ()),
        ),
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
    """Path and map from above and from the side; below, position over time, and status."""
    with mpl.rc_context(STYLE):
        figure = LaidOutFigure(figsize=(10.5, 7.6))
        rows = len(_said(tracked))
        grid = figure.add_gridspec(3, 2, height_ratios=(4.4, 2.4, 0.24 * rows))
        for k, view in enumerate(_VIEWS):
            _draw_path(figure.add_subplot(grid[0, k]), tracked, cloud, *view)
        figure.axes[1].invert_yaxis()
        over_time = figure.add_subplot(grid[1, :])
        _draw_over_time(over_time, tracked)
        _draw_status(figure.add_subplot(grid[2, :], sharex=over_time), tracked)
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
    t_s = (tracked.trajectory.t_us - tracked.span_us[0]) / 1e6
    for k, (name, dash) in enumerate((("x", "-"), ("y", "--"), ("z", ":"))):
        at_m = tracked.trajectory.positions_m[:, k]
        (line,) = axes.plot(t_s, at_m, dash, lw=1.3, label=name)
        off_m = 2 * np.sqrt(tracked.covariances[:, k, k])
        colour = line.get_color()
        axes.fill_between(t_s, at_m - off_m, at_m + off_m, color=colour, alpha=0.15, lw=0)
    axes.set(ylabel="position [m]")
    axes.tick_params(labelbottom=False)
    axes.legend(loc="upper left", ncols=3, frameon=False)
    axes.grid(linewidth=0.4, alpha=0.35)


def _said(tracked: Tracked) -> list[Status]:
    """Each status that it had, the first of `_COLOURS` lowest."""
    return [status for status in _COLOURS if status in {c.status for c in tracked.changes}]


def _draw_status(axes: Axes, tracked: Tracked) -> None:
    """A row per status, and when it was so."""
    first_us, last_us = tracked.span_us
    begins_s = [(change.t_us - first_us) / 1e6 for change in tracked.changes]
    ends_s = [*begins_s[1:], (last_us - first_us) / 1e6]
    said = _said(tracked)
    for change, begin_s, end_s in zip(tracked.changes, begins_s, ends_s, strict=True):
        row, colour = said.index(change.status), _COLOURS[change.status]
        axes.broken_barh([(begin_s, end_s - begin_s)], (row - 0.4, 0.8), color=colour)
    axes.set_yticks(range(len(said)), [status.value for status in said])
    axes.set(xlabel="time [s]", ylim=(-0.5, len(said) - 0.5))
    axes.grid(linewidth=0.4, alpha=0.35)


def _moving(tracked: Tracked, figure: Figure) -> Moving:
    """Where the body is at each step of the slider, on all panels."""
    count = len(tracked.trajectory)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST_STEPS)).astype(int))
    t_s = (tracked.trajectory.t_us[chosen] - tracked.span_us[0]) / 1e6
    places = tracked.trajectory.positions_m[chosen]
    *views, over_time, status = figure.axes
    dots = tuple(
        _shares(figure, axes, places[:, [across, up]])
        for axes, (_, across, up) in zip(views, _VIEWS, strict=True)
    )
    line = _shares(figure, over_time, np.column_stack([t_s, np.zeros_like(t_s)]))
    names = tuple(
        f"{time:.2f} s, {tracked.statuses[k].value}" for time, k in zip(t_s, chosen, strict=True)
    )
    from_top = 1 - over_time.get_position().y1, 1 - status.get_position().y0
    return Moving(names, dots, tuple(x for x, _ in line), from_top)


def _shares(
    figure: Figure, axes: Axes, points: NDArray[np.float64]
) -> tuple[tuple[float, float], ...]:
    """(N, 2) points of a panel as shares of the figure's width, and of its height from the top."""
    places = figure.transFigure.inverted().transform(axes.transData.transform(points))
    return tuple((round(float(x), 4), round(1 - float(y), 4)) for x, y in places)
