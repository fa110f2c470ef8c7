"""The page of a tracked recording: its path and map from above and from the side, its status."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eventsweep.emvs.depth.point_cloud import PointCloud
from eventsweep.eval.figures.colormaps import INK, nice_between
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.figures.plots import STYLE, svg
from eventsweep.eval.report.html import (
    Grid,
    GridCell,
    Head,
    Moving,
    Page,
    Plot,
    Section,
    Sentences,
    Text,
    grid,
    made_here,
    page_text,
    plural,
)
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import Tracked
from eventsweep.plugins.track.odometry.trust import WAITS
from eventsweep.plugins.track.scored import Judged

_MOST_POINTS = 4000  # of the map, drawn
_MOST_STEPS = 200  # of the slider
_MOST_LINES = 1000  # of the path
_GAP_US = 50_000  # as `Tracked.covered` counts
_VIEWS = (("path from above", 0, 2), ("with the map, from above", 0, 2), ("from the side", 2, 1))
_COLOURS = {
    Status.TRACKING: "#009e73",
    Status.UNCERTAIN: "#cc79a7",
    Status.STILL: "#56b4e9",
    Status.COASTING: "#e69f00",
    Status.LOST: "#d55e00",
    Status.STARTING: "#999999",
}


def track_page(
    name: str, tracked: Tracked, cloud: PointCloud, score: Judged | None = None, command: str = ""
) -> str:
    """The page as HTML."""
    has_scores = score is not None and score.found is not None
    figure = _overview(tracked, cloud)
    text = Text(
        "The path has the colours of its status, below. Axes are those of the first pose's world: "
        "for a body that looks ahead x points right, y down, z forward. Grey: points of the maps. "
        "Bands: two standard deviations."
    )
    about = "path and map from above and from the side; position and status over time"
    drawing = svg(lambda: figure)  # finds the layout, too
    plot = Plot(drawing, about, _moving(tracked, figure))
    page = Page(
        title=f"{name}, tracked",
        subtitle=f"{len(tracked.trajectory):,} poses, {maps_words(tracked)}.",
        blocks=(
            Text(lead(tracked), "lead"),
            Sentences(tuple(_findings(tracked, score))),
        ),
        sections=(
            Section("path", "Path", (plot, text)),
            Section("status", "Status", (_changes(tracked), _counts(tracked))),
            *(() if score is None else (score.section(),)),
            made_here(command),
        ),
        files=(
            "trajectory.txt",
            "covariances.txt",
            "track.json",
            "cloud.ply",
            *(("results.json", "results.csv") if has_scores else ()),
        ),
        verdict=_verdict(tracked),
    )
    return page_text(page)


def maps_words(tracked: Tracked) -> str:
    """How many maps were made; the one that the track begins with is not among those counted."""
    return plural(tracked.maps, "map") if tracked.maps else "no map beside the first"


def lead(tracked: Tracked) -> str:
    """How much was tracked, and how surely, in one sentence."""
    first_us, last_us = tracked.span_us
    lost = sum(change.status is Status.LOST for change in tracked.changes)
    uncertain = tracked.statuses.count(Status.UNCERTAIN)
    said = [
        f"{100 * tracked.covered:.1f} % of {(last_us - first_us) / 1e6:.2f} s tracked",
        f"lost {plural(lost, 'time')}" if lost else "never lost",
        *([f"{uncertain:,} of {len(tracked.statuses):,} poses uncertain"] if uncertain else []),
    ]
    return f"{', '.join(said)}."


def _verdict(tracked: Tracked) -> str:
    said = {change.status for change in tracked.changes} | {*tracked.statuses}
    if tracked.changes[-1].status is Status.LOST:
        return "wrong"
    return "doubtful" if said & {Status.LOST, Status.UNCERTAIN} else "good"


def _findings(tracked: Tracked, score: Judged | None) -> Iterator[str]:
    """What to do where it is not sure, and how it compares with true poses."""
    if any(change.reason in WAITS for change in tracked.changes):
        yield (
            "Too short: a second map confirms the beginning, and a longer way the poses, so track "
            "a longer stretch."
        )
    elif _verdict(tracked) != "good":
        yield (
            "What to do: use the poses of the stretches that are tracking; the table of changes "
            "says when and why others are not. Then “eventsweep check RECORDING” looks for faults "
            "in events, calibration and clocks."
        )
    if score is not None:
        yield score.lead()


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
    """The path, with the map from above and from the side; below, position and status over time."""
    with mpl.rc_context(STYLE):
        figure = LaidOutFigure(figsize=(10.5, 7.2))
        rows = len(_said(tracked))
        grid = figure.add_gridspec(3, len(_VIEWS), height_ratios=(4.0, 2.4, 0.24 * rows))
        for k, (title, across, up) in enumerate(_VIEWS):
            axes = figure.add_subplot(grid[0, k])
            _draw_path(axes, tracked, cloud if k else None, across, up)
            axes.set_title(title, fontsize=10, loc="left")
        figure.axes[-1].invert_yaxis()
        over_time = figure.add_subplot(grid[1, :])
        _draw_over_time(over_time, tracked)
        _draw_status(figure.add_subplot(grid[2, :], sharex=over_time), tracked)
    return figure


def _draw_path(
    axes: Axes, tracked: Tracked, cloud: PointCloud | None, across: int, up: int
) -> None:
    """The path with the map, or alone, as large as it fits, with its ends and a scale bar."""
    places = tracked.trajectory.positions_m[:, [across, up]]
    if cloud is not None:
        points = cloud.points_world[:: max(1, len(cloud) // _MOST_POINTS)]
        axes.plot(
            points[:, across], points[:, up], ".", ms=1, color="#999999", rasterized=True, zorder=1
        )
    axes.add_collection(_by_status(tracked, places))
    axes.autoscale_view()
    if cloud is None:
        _scale_bar(axes, places)
    for place, name in ((places[0], "start"), (places[-1], "end")):
        axes.plot(*place, "o" if name == "start" else "s", ms=5, mfc="none", color=INK)
        if cloud is None:
            axes.annotate(name, place, (5, 5), textcoords="offset points", fontsize=9)
    axes.set_aspect("equal", adjustable="box" if cloud is None else "datalim")
    axes.set(xlabel=f"{'xyz'[across]} [m]", ylabel=f"{'xyz'[up]} [m]")
    axes.grid(linewidth=0.4, alpha=0.35)


def _by_status(tracked: Tracked, places: NDArray[np.float64]) -> LineCollection:
    """The path in the colours of its status; gaps are left open."""
    t_us = tracked.trajectory.t_us
    chosen = np.unique(np.linspace(0, len(t_us) - 1, min(len(t_us), _MOST_LINES)).astype(int))
    gaps = np.cumsum(np.diff(t_us, prepend=t_us[0]) > _GAP_US)[chosen]
    begins, ends = chosen[:-1][np.diff(gaps) == 0], chosen[1:][np.diff(gaps) == 0]
    lines = np.stack([places[begins], places[ends]], axis=1)
    colours = [_COLOURS[tracked.statuses[k]] for k in ends]
    return LineCollection(list(lines), colors=colours, linewidths=2.0, capstyle="round")


def _scale_bar(axes: Axes, places: NDArray[np.float64]) -> None:
    """A round length below the path, and as much room around both."""
    low, high = places.min(axis=0), places.max(axis=0)
    reach_m = max(float((high - low).max()), 1e-3)
    length_m = nice_between(0.15 * reach_m, 0.45 * reach_m)[0]
    middle, half = (low + high) / 2, 0.75 * reach_m
    (left, bottom), (right, top) = middle - half, middle + half
    x, y = left + 0.1 * reach_m, bottom + 0.1 * reach_m
    axes.plot([x, x + length_m], [y, y], color=INK, lw=3, solid_capstyle="butt")
    text = f"{length_m:g} m" if length_m >= 1 else f"{100 * length_m:g} cm"
    axes.annotate(text, (x, y), (0, 5), textcoords="offset points", fontsize=9)
    axes.set(xlim=(left, right), ylim=(bottom, top))


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
