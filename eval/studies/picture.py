"""A study's figure: error, bad pixels and points of every method over what is spoilt."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from emvs.atomic import atomic_path
from eval.line_styles import line_style
from eval.studies.curves import BREAKS_AT, METRICS, Curve
from eval.studies.study import Study

_TITLES = {"mean_error": "mean error", "bad_published": "bad pixels", "points": "points"}


def draw(study: Study, curves: Sequence[Curve], path: Path) -> None:
    """Draws three panels with 95 % bands, and a cross where a method breaks; writes PNG or SVG."""
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    panels = figure.subplots(1, len(METRICS))
    for axes, metric in zip(panels, METRICS, strict=True):
        _draw_panel(axes, study, [curve for curve in curves if curve.metric == metric])
    handles, labels = panels[0].get_legend_handles_labels()
    figure.supxlabel(f"{study.axis} [{study.unit}]", fontsize=10)
    figure.legend(handles, labels, loc="outside right center", frameon=False, fontsize=9)
    with atomic_path(path) as partial, partial.open("wb") as stream:
        figure.savefig(stream, format=path.suffix[1:], dpi=130, facecolor="white")


def _draw_panel(axes: Axes, study: Study, curves: Sequence[Curve]) -> None:
    places = study.amounts
    for curve in curves:
        style = line_style(curve.method)
        axes.fill_between(places, curve.low, curve.high, color=style.colour, alpha=0.13, lw=0)
        axes.plot(
            places, curve.mean, color=style.colour, linestyle=style.dash, lw=1.5,
            marker=style.marker or ".", markersize=4.5, label=curve.method,
        )  # fmt: skip
        broken = curve.breaking_amount() if curve.metric == METRICS[0] else None
        if broken is not None:
            axes.plot([broken], [BREAKS_AT * curve.mean[0]], "x", color=style.colour, ms=8, mew=2)
    _label(axes, study, curves[0])


def _label(axes: Axes, study: Study, curve: Curve) -> None:
    axes.set_title(_TITLES[curve.metric], loc="left", fontsize=10)
    axes.set_ylabel(curve.unit, fontsize=9)
    axes.set_ylim(bottom=0)
    axes.grid(linewidth=0.4, alpha=0.35)
    axes.spines[["top", "right"]].set_visible(False)
    if study.logarithmic:
        axes.set_xscale("log")
        axes.set_xticks(study.amounts, [f"{amount:g}" for amount in study.amounts], fontsize=8)
        axes.minorticks_off()
    elif study.amounts[-1] > 15 * study.amounts[1] > 0:
        axes.set_xscale("symlog", linthresh=study.amounts[1], linscale=0.4)
        axes.set_xlim(left=-study.amounts[1] / 3)
        axes.set_xticks(study.amounts, [f"{amount:g}" for amount in study.amounts], fontsize=8)
        axes.minorticks_off()
    if study.amounts[-1] < study.amounts[0]:
        axes.invert_xaxis()
