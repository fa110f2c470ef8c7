"""Why outliers are outliers: one stacked bar per method, as long as its share of outliers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import matplotlib as mpl
from matplotlib.figure import Figure

from eval.method_scores import CAUSE_PREFIX
from eval.plots import STYLE, svg_of
from eval.results import Row
from eval.taxonomy import CAUSES

# Okabe and Ito's colours in the order of the causes, black replaced: it has no place on dark.
_COLOURS = (
    "#999999", "#cc79a7", "#0072b2", "#d55e00", "#e69f00", "#56b4e9", "#009e73", "#f0e442",
)  # fmt: skip
_BAR_INCHES = 0.27


def outlier_causes(
    rows: Sequence[Row], methods: Sequence[str]
) -> dict[str, tuple[float, dict[str, float]]]:
    """Per method the share of outliers and the share of each cause among them, all in %.

    Args:
        rows: of one case and window.
        methods: in the order wanted; those without causes are left out.
    """
    values = {(row.method, row.metric): row.value for row in rows}
    found = {}
    for method in methods:
        share = values.get((method, "outlier_share"), math.nan)
        causes = {c: values.get((method, CAUSE_PREFIX + c), math.nan) for c in CAUSES}
        if math.isfinite(share) and all(map(math.isfinite, causes.values())):
            found[method] = (share, causes)
    return found


def causes_figure(shares: Mapping[str, tuple[float, dict[str, float]]]) -> Figure:
    """Draws stacked bars; made within a context of `STYLE`.

    Args:
        shares: from `outlier_causes`, not empty.
    """
    figure = Figure(figsize=(10.5, 1.1 + _BAR_INCHES * len(shares)), layout="constrained")
    axes = figure.subplots()
    for cause, colour in zip(CAUSES, _COLOURS, strict=True):
        lengths = [share * causes[cause] / 100 for share, causes in shares.values()]
        before = [
            share * sum(value for name, value in causes.items() if _comes_before(name, cause)) / 100
            for share, causes in shares.values()
        ]
        axes.barh(
            list(shares), lengths, left=before, height=0.74, color=colour,
            label=cause.replace("_", " "),
        )  # fmt: skip
    axes.invert_yaxis()
    axes.set_xlabel("points with an error above 10 % of the true depth, share of all points [%]")
    axes.grid(axis="x", linewidth=0.4, alpha=0.35)
    axes.set_axisbelow(True)
    axes.tick_params(axis="y", length=0)
    figure.legend(loc="outside right center", handlelength=1.2)
    return figure


def causes_svg(shares: Mapping[str, tuple[float, dict[str, float]]]) -> str:
    """The bars as SVG that takes the colour of the text around it."""
    with mpl.rc_context(STYLE):
        return svg_of(causes_figure(shares))


def _comes_before(name: str, cause: str) -> bool:
    order = list(CAUSES)
    return order.index(name) < order.index(cause)
