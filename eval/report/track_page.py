"""The page of a tracked recording: its path and map from above and from the side, its status."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eventsweep.emvs.depth.point_cloud import PointCloud
from eventsweep.emvs.odometry.recorded import Tracked
from eventsweep.emvs.odometry.tracker import Status
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.figures.plots import ESTIMATE_COLOUR, svg
from eventsweep.eval.report.html import (
    Grid,
    GridCell,
    Head,
    Page,
    Section,
    page_text,
    plural,
    svg_uri,
    versions_grid,
)

_MOST_POINTS = 4000  # of the map, drawn
_COLOURS = {
    Status.TRACKING: "#009e73",
    Status.STILL: "#56b4e9",
    Status.COASTING: "#e69f00",
    Status.LOST: "#d55e00",
    Status.STARTING: "#999999",
}


def track_page(name: str, tracked: Tracked, cloud: PointCloud) -> str:
    """The page as HTML."""
    installed = versions()
    lost = sum(change.status is Status.LOST for change in tracked.changes)
    path = Section(
        "path", "Path", ("Status",), (_changes(tracked),),
        text="Axes are those of the first pose's world: for a body that looks ahead x points "
        "right, y down, z forward. Grey: points of the maps.",
        figure=svg_uri(svg(_paths, tracked, cloud)),
        figure_about="path and map from above and from the side",
    )  # fmt: skip
    status = Section(
        "status", "Over time", ("Poses",), (_counts(tracked),),
        figure=svg_uri(svg(_over_time, tracked)), figure_about="place and status over time",
    )  # fmt: skip
    first_us, last_us = tracked.span_us
    return page_text(
        Page(
            title=f"{name}, tracked",
            subtitle=f"{len(tracked.trajectory):,} poses over {(last_us - first_us) / 1e6:.2f} s, "
            f"{100 * tracked.covered:.1f} % of the time covered, {plural(tracked.maps, 'map')}, "
            f"lost {plural(lost, 'time')}",
            sections=(path, status),
            provenance=versions_grid(["this page"], [installed]),
            version=installed["eventsweep"],
            files=("trajectory.txt", "track.json", "cloud.ply"),
        )
    )


def _changes(tracked: Tracked) -> Grid:
    first_us = tracked.span_us[0]
    lines = tuple(
        (
            GridCell(f"{(change.t_us - first_us) / 1e6:.3f}", change.t_us),
            GridCell(change.status.value),
            GridCell(change.reason),
        )
        for change in tracked.changes
    )
    return Grid((Head("time", "s"), Head("status", text=True), Head("reason", text=True)), lines)


def _counts(tracked: Tracked) -> Grid:
    counts = {status: sum(each is status for each in tracked.statuses) for status in Status}
    lines = tuple((GridCell(s.value), GridCell(f"{n:,}", n)) for s, n in counts.items() if n)
    return Grid((Head("status", text=True), Head("poses", direction="higher")), lines)


def _paths(tracked: Tracked, cloud: PointCloud) -> Figure:
    figure = LaidOutFigure(figsize=(10.5, 4.4))
    panels = figure.subplots(1, 2)
    step = max(1, len(cloud) // _MOST_POINTS)
    views = (("from above", 0, 2), ("from the side", 2, 1))
    for axes, (title, across, up) in zip(panels, views, strict=True):
        points, places = cloud.points_world[::step], tracked.trajectory.positions_m
        axes.plot(points[:, across], points[:, up], ".", ms=1, color="#999999", rasterized=True)
        axes.plot(places[:, across], places[:, up], lw=1.6, color=ESTIMATE_COLOUR)
        axes.plot(*places[0, [across, up]], "o", ms=4, color=ESTIMATE_COLOUR)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(title, fontsize=10, loc="left")
        axes.set_xlabel(f"{'xyz'[across]} [m]")
        axes.set_ylabel(f"{'xyz'[up]} [m]")
        axes.grid(linewidth=0.4, alpha=0.35)
    panels[1].invert_yaxis()
    return figure


def _over_time(tracked: Tracked) -> Figure:
    figure = LaidOutFigure(figsize=(10.5, 3.0))
    axes = figure.subplots()
    first_us, last_us = tracked.span_us
    t_s = (tracked.trajectory.t_us - first_us) / 1e6
    for k, (name, dash) in enumerate((("x", "-"), ("y", "--"), ("z", ":"))):
        axes.plot(t_s, tracked.trajectory.positions_m[:, k], dash, lw=1.3, label=name)
    _shade(axes, tracked, (last_us - first_us) / 1e6)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("position [m]")
    axes.grid(linewidth=0.4, alpha=0.35)
    figure.legend(loc="outside upper right", ncols=8)
    return figure


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
