"""A study's figure: error, bad pixels and points of every method over what is perturbed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from emvs.utils.files import atomic_path
from eval.figures.colormaps import line_style
from eval.studies.curves import BREAKS_AT, METRICS, RobustnessCurve
from eval.studies.study import Study

_TITLES = {"mean_error": "mean error", "bad_published": "bad pixels", "points": "points"}


def sample_words(cases: Sequence[str], seeds: Sequence[int]) -> str:
    """What was averaged, in words."""
    return f"{', '.join(cases)}; {len(seeds)} seed{'s' * (len(seeds) != 1)} each"


def draw(study: Study, curves: Sequence[RobustnessCurve], path: Path, samples: str) -> None:
    """Draws three panels with 95 % bands, and a cross where a method breaks; writes PNG or SVG.

    Args:
        study: what was perturbed.
        curves: all methods and metrics.
        path: of the picture.
        samples: what was averaged, in words.
    """
    figure = Figure(figsize=(11, 3.8), layout="constrained")
    figure.suptitle(f"{study.name} ({samples})", x=0.01, ha="left", fontsize=10)
    panels = figure.subplots(1, len(METRICS))
    for axes, metric in zip(panels, METRICS, strict=True):
        _draw_panel(axes, study, [curve for curve in curves if curve.metric == metric])
    handles, labels = panels[0].get_legend_handles_labels()
    handles += [Line2D([], [], color="0.3", marker="x", ms=8, mew=2, lw=0)]
    labels += [f"breaks: {BREAKS_AT:g} x the\nfirst mean error"]
    figure.supxlabel(f"{study.axis} [{study.unit}]", fontsize=10)
    figure.legend(handles, labels, loc="outside right center", frameon=False, fontsize=9)
    with atomic_path(path) as partial, partial.open("wb") as stream:
        figure.savefig(stream, format=path.suffix[1:], dpi=130, facecolor="white")


def _draw_panel(axes: Axes, study: Study, curves: Sequence[RobustnessCurve]) -> None:
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


def _label(axes: Axes, study: Study, curve: RobustnessCurve) -> None:
    axes.set_title(f"{_TITLES[curve.metric]} [{curve.unit}]", loc="left", fontsize=10)
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
