"""Trajectories drawn: the path from above and from the side, errors over time, errors by way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.figures.colormaps import INK, line_style
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.scoring.trajectories.errors import Step
from eventsweep.eval.scoring.trajectories.score import TrajectoryScore

Scored = Mapping[str, TrajectoryScore]
_MOST_POINTS = 2000
_GAP_STEPS = 10
_GREY = "#8c8c8c"


def path_figure(truth: Trajectory, scored: Scored) -> Figure:
    """The aligned path, from above (x to the right, y up) and from the side (z up), in m.

    Lines have the ids `path-above-{position}` and `path-side-{position}`.
    """
    figure = LaidOutFigure(figsize=(10.5, 4.6))
    panels = figure.subplots(1, 2)
    for axes, name, (right, up) in zip(panels, ("above", "side"), ((0, 1), (0, 2)), strict=True):
        true_m = _thinned(truth.positions_m)
        axes.plot(true_m[:, right], true_m[:, up], color=_GREY, lw=5, alpha=0.4)
        for position, (method, found) in enumerate(scored.items()):
            path_m = _thinned(_aligned_path_m(found))
            (line,) = axes.plot(path_m[:, right], path_m[:, up], **_line(method))
            line.set_gid(f"path-{name}-{position}")
        axes.set_title({"above": "from above", "side": "from the side"}[name], loc="left",
                       fontsize=10)  # fmt: skip
        axes.set(xlabel="x [m]", ylabel=f"{'xyz'[up]} [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(linewidth=0.4, alpha=0.35)
    _legend(figure, scored, with_truth=True)
    return figure


def errors_figure(truth: Trajectory, scored: Scored) -> Figure:
    """Absolute errors of translation and rotation over time; gaps are left open."""
    figure = LaidOutFigure(figsize=(10.5, 4.2))
    panels = figure.subplots(2, 1, sharex=True)
    first_us = truth.t_us[0]
    for position, (method, found) in enumerate(scored.items()):
        t_s = (found.matched.t_us - first_us) / 1e6
        columns = 100 * found.errors.poses.translation_m, found.errors.poses.rotation_deg
        for axes, name, values in zip(panels, ("translation", "rotation"), columns, strict=True):
            (line,) = axes.plot(*_with_gaps(t_s, values), **_line(method))
            line.set_gid(f"errors-{name}-{position}")
    for axes, label in zip(panels, ("translation [cm]", "rotation [°]"), strict=True):
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0)
        axes.set_xlim(0, (truth.t_us[-1] - first_us) / 1e6)
        axes.grid(linewidth=0.4, alpha=0.35)
    panels[1].set_xlabel("time since the first true pose [s]")
    _legend(figure, scored)
    return figure


def boxes_figure(scored: Scored) -> Figure:
    """Relative errors by the way that they are taken over: quartiles, whiskers to 5 and 95 %."""
    figure = LaidOutFigure(figsize=(10.5, 3.4))
    panels = figure.subplots(1, 2)
    steps = [step for step in _first(scored).errors.steps if step.unit in ("pct", "m")]
    for axes, column, label in zip(
        panels, ("translation_m", "rotation_deg"), ("drift of translation [%]", "rotation [°]"),
        strict=True,
    ):  # fmt: skip
        _draw_boxes(axes, scored, steps, column)
        axes.set(xlabel="way between two poses [m]", ylabel=label)
        axes.set_ylim(bottom=0)
        axes.grid(axis="y", linewidth=0.4, alpha=0.35)
    _legend(figure, scored)
    return figure


def _draw_boxes(axes: Axes, scored: Scored, steps: list[Step], column: str) -> None:
    width = 0.8 / len(scored)
    for position, (method, found) in enumerate(scored.items()):
        errors = [found.errors.steps[step] for step in steps]
        values = [
            100 * error.translation_m / error.way_m
            if column == "translation_m"
            else error.rotation_deg
            for error in errors
        ]
        at = np.arange(len(steps)) + (position - (len(scored) - 1) / 2) * width
        drawn = [k for k, value in enumerate(values) if value.size]
        if not drawn:  # Matplotlib fails on no box at all
            continue
        colour = line_style(method).colour
        axes.boxplot(
            [values[k] for k in drawn], positions=at[drawn].tolist(), widths=0.85 * width,
            whis=(5, 95), showfliers=False, patch_artist=True, manage_ticks=False,
            boxprops={"facecolor": colour, "alpha": 0.55, "edgecolor": colour},
            medianprops={"color": INK, "linewidth": 1.4}, whiskerprops={"color": colour},
            capprops={"color": colour},
        )  # fmt: skip
    axes.set_xticks(range(len(steps)), [_length(step, _first(scored)) for step in steps])
    axes.set_xlim(-0.5, len(steps) - 0.5)


def _length(step: Step, found: TrajectoryScore) -> str:
    if step.unit == "m":
        return f"{step.value:g}"
    return f"{step.value / 100 * found.errors.way_m:.2g}\n{step.value:g} %"


def _first(scored: Scored) -> TrajectoryScore:
    return next(iter(scored.values()))


def _line(method: str) -> dict[str, Any]:
    style = line_style(method)
    return {"color": style.colour, "linestyle": style.dash, "linewidth": 1.3}


def _legend(figure: Figure, scored: Scored, *, with_truth: bool = False) -> None:
    handles = [Line2D([], [], label=method, **_line(method)) for method in scored]
    if with_truth:
        handles.insert(0, Line2D([], [], color=_GREY, lw=5, alpha=0.4, label="truth"))
    figure.legend(handles=handles, loc="outside right center", handlelength=3.2)


def _aligned_path_m(found: TrajectoryScore) -> NDArray[np.float64]:
    """Positions in the truth's world; the last one before a gap is NaN."""
    path_m = found.world_odom.points(found.matched.T_odom_body[:, :3, 3])
    steps_us = np.diff(found.matched.t_us)
    path_m[:-1][steps_us > _GAP_STEPS * np.median(steps_us)] = np.nan
    return path_m


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """About so many points, as a page must stay small; NaN where one of those left out is."""
    begins = np.arange(0, len(points), max(1, len(points) // _MOST_POINTS))
    broken = np.isnan(np.add.reduceat(points[:, 0], begins))
    return np.where(broken[:, None], np.nan, points[begins])


def _with_gaps(
    t_s: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A line that is interrupted where no pose is for more than ten median steps.

    Of several neighbours the largest error stays, so that no peak is lost.
    """
    size = max(1, len(t_s) // _MOST_POINTS)
    begins = np.arange(0, len(t_s), size)
    at, peaks = t_s[begins], np.fmax.reduceat(values, begins)
    steps = np.diff(at)
    jumps = (
        np.flatnonzero(steps > _GAP_STEPS * np.median(steps)) + 1
        if steps.size
        else np.empty(0, int)
    )
    return np.insert(at, jumps, np.nan), np.insert(peaks, jumps, np.nan)
