"""A study's rows as curves, and its figure: error over what is perturbed, with a band."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from eventsweep.emvs.errors import significant
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.eval.figures.colormaps import INK, line_style
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.figures.plots import STYLE
from eventsweep.eval.found_poses import TRACK
from eventsweep.eval.numbers import display_unit, in_display_unit
from eventsweep.eval.scoring.significance import stratified_interval
from eventsweep.eval.studies.definitions import Study

if TYPE_CHECKING:
    import pandas as pd

METRICS = ("mean_error", "bad_published", "points")
POSE_METRICS = ("ate_share", "time_covered")
"""Of poses that are found from events, where a study asks for them."""
BREAKS_AT = 2.0
"""A method breaks where its error is this many times its unperturbed one."""
_ROOM = 1.25  # above the highest mean; bands of few seeds reach far beyond
_BAND = 0.15
_TITLES = {"mean_error": "mean error", "bad_published": "bad pixels", "points": "points",
           "ate_share": "ATE of path", "time_covered": "time covered"}  # fmt: skip


@dataclass(frozen=True, eq=False)
class RobustnessCurve:
    """One metric of one method over the amounts.

    Attributes:
        amounts: (A,) in the study's order.
        mean: (A,) mean over cases of the mean over seeds; NaN where a sample has no value.
        low: (A,) the first mean, and above it the lower end of the 95 % interval of the paired
            difference to it over seeds, cases held fixed; NaN for one seed.
        high: (A,) the same with the upper end.
        samples: (A,) samples with a value.
    """

    method: str
    metric: str
    unit: str
    amounts: tuple[float, ...]
    mean: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    samples: NDArray[np.int64]

    def breaking_amount(self) -> float | None:
        """The amount at which the value passes `BREAKS_AT` times its first one, interpolated.

        None where it never does. Amounts without a value count as broken: there is no map.
        """
        limit = BREAKS_AT * self.mean[0]
        broken = ~(self.mean <= limit)
        if not np.isfinite(self.mean[0]) or not broken.any():
            return None
        k = int(np.argmax(broken))
        if not np.isfinite(self.mean[k]):
            return self.amounts[k]
        share = (limit - self.mean[k - 1]) / (self.mean[k] - self.mean[k - 1])
        return float(self.amounts[k - 1] + share * (self.amounts[k] - self.amounts[k - 1]))


def curves(
    rows: pd.DataFrame, amounts: Sequence[float], methods: Sequence[str], cases: Sequence[str]
) -> list[RobustnessCurve]:
    """One curve per metric and method, of means over cases; poses that were found come last.

    Args:
        rows: `case`, `amount`, `method`, `metric`, `value`, `unit`; a row per seed.
        amounts: in the study's order.
        methods: in the order of the curves.
        cases: each weighs the same.
    """
    import pandas as pd  # 0.3 s, which help need not wait for

    keys = ["method", "metric", "amount", "case"]
    samples = {
        key: part.set_index("seed")["value"].astype(float)
        for key, part in rows.groupby(keys, sort=False)
    }
    units = rows.groupby("metric")["unit"].first()
    wanted = [(metric, method) for metric in METRICS for method in methods]
    if (rows["method"] == TRACK).any():
        wanted += [(metric, TRACK) for metric in POSE_METRICS]
    none = pd.Series([math.nan])
    return [
        _curve(
            method, metric, str(units.get(metric, "")), amounts,
            [[samples.get((method, metric, a, case), none) for case in cases] for a in amounts],
        )
        for metric, method in wanted
    ]  # fmt: skip


def _curve(
    method: str, metric: str, unit: str, amounts: Sequence[float],
    groups: Sequence[Sequence[pd.Series[float]]],
) -> RobustnessCurve:  # fmt: skip
    """Of each amount the seeds of every case, the unperturbed one first."""
    mean = np.array([np.mean([seeds.mean(skipna=False) for seeds in of]) for of in groups])
    bands = mean[0] + np.array([_paired_interval(groups[0], cases) for cases in groups])
    samples = np.array([sum(np.isfinite(seeds).sum() for seeds in cases) for cases in groups])
    return RobustnessCurve(
        method, metric, unit, tuple(amounts), mean, bands[:, 0], bands[:, 1], samples
    )


def _paired_interval(
    first: Sequence[pd.Series[float]], other: Sequence[pd.Series[float]]
) -> tuple[float, float]:
    """Of the difference of the same cases and seeds: how hard a scene is falls out of it."""
    differences = [(b - a).to_numpy() for a, b in zip(first, other, strict=True)]
    return stratified_interval(differences)


def sample_words(cases: Sequence[str], seeds: Sequence[int]) -> str:
    """What was averaged, in words."""
    return f"{', '.join(cases)}; {len(seeds)} seed{'s' * (len(seeds) != 1)} each"


def draw(study: Study, curves: Sequence[RobustnessCurve], path: Path, samples: str) -> None:
    """Draws a panel per metric, with a cross where a method breaks, and writes PNG or SVG.

    Bands are of 95 %, paired with the unperturbed case, and left out where they are as wide as
    their panel. `samples` says what was averaged.
    """
    with mpl.rc_context(STYLE):
        figure = _figure(study, curves, samples)
        with atomic_path(path) as partial, partial.open("wb") as stream:
            # A file has no page around it; `eval.report.study_page` gives it the page's ground.
            undated = {"Date": None} if path.suffix == ".svg" else None
            figure.savefig(
                stream, format=path.suffix[1:], dpi=130, facecolor="white", metadata=undated
            )


def _figure(study: Study, curves: Sequence[RobustnessCurve], samples: str) -> Figure:
    metrics = tuple(dict.fromkeys(curve.metric for curve in curves))
    figure = LaidOutFigure(figsize=(11 + 3 * (len(metrics) - len(METRICS)), 3.8))
    figure.suptitle(f"{study.name} ({samples})", x=0.01, ha="left", fontsize=10)
    panels = figure.subplots(1, len(metrics))
    for axes, metric in zip(panels, metrics, strict=True):
        _draw_panel(axes, study, [curve for curve in curves if curve.metric == metric])
    handles, labels = panels[0].get_legend_handles_labels()
    handles += [Line2D([], [], color=INK, marker="x", ms=8, mew=2, lw=0)]
    labels += [f"breaks: {BREAKS_AT:g} x the\nfirst mean error"]
    if any(np.isfinite(curve.high[1:]).any() for curve in curves):
        handles += [Patch(color=INK, alpha=_BAND, lw=0)]
        labels += [f"95 % interval of the\nchange from {study.amounts[0]:g} {study.unit}"]
    figure.supxlabel(f"{study.axis} [{study.unit}]", fontsize=10)
    figure.legend(handles, labels, loc="outside right center", fontsize=9)
    return figure


def _draw_panel(axes: Axes, study: Study, curves: Sequence[RobustnessCurve]) -> None:
    places = study.amounts
    highest = max((float(m) for curve in curves for m in curve.mean if np.isfinite(m)), default=0)
    for curve in curves:
        style = line_style(curve.method)
        # A band as wide as the panel, as few seeds have, would hide the curves and say nothing.
        known = curve.high - curve.low < highest
        axes.fill_between(
            places, curve.low, curve.high, where=known.tolist(), color=style.colour, alpha=_BAND,
            lw=0,
        )  # fmt: skip
        axes.plot(
            places, curve.mean, color=style.colour, linestyle=style.dash, lw=1.5,
            marker=style.marker or ".", markersize=4.5, label=curve.method,
        )  # fmt: skip
        broken = curve.breaking_amount() if curve.metric == METRICS[0] else None
        if broken is not None:
            axes.plot([broken], [BREAKS_AT * curve.mean[0]], "x", color=style.colour, ms=8, mew=2)
    _label(axes, study, curves[0])
    axes.set_ylim(0, _ROOM * highest or None)


def _label(axes: Axes, study: Study, curve: RobustnessCurve) -> None:
    unit = curve.unit
    axes.set_ylabel(f"{_TITLES[curve.metric]} [{display_unit(unit)}]")
    axes.yaxis.set_major_formatter(lambda value, _: significant(in_display_unit(value, unit)))
    axes.grid(linewidth=0.4, alpha=0.35)
    if study.logarithmic:
        axes.set_xscale("log")
        axes.set_xticks(study.amounts, [f"{amount:g}" for amount in study.amounts], fontsize=8)
        axes.minorticks_off()
    elif study.amounts[-1] > 15 * (least := study.amounts[:2][-1]) > 0:
        axes.set_xscale("symlog", linthresh=least, linscale=0.4)
        axes.set_xlim(left=-least / 3)
        axes.set_xticks(study.amounts, [f"{amount:g}" for amount in study.amounts], fontsize=8)
        axes.minorticks_off()
    if study.amounts[-1] < study.amounts[0]:
        axes.invert_xaxis()
