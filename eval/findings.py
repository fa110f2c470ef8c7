"""What a table says, in words: printed by the command line, and heading the report."""

from __future__ import annotations

import math
from collections.abc import Sequence

from eval.ranking import FUSED_PREFIX, SINGLE_PREFIX, column, order, shown, with_unit
from eval.scoring.method_scores import CAUSE_PREFIX
from eval.scoring.results import Row

HARMONIC = "Alg1/H"


def fusion_order(rows: Sequence[Row], metric: str) -> str:
    """The fusion functions from best to worst, for example `H < G < A`; empty below two."""
    ranked = [pair for pair in order(rows, metric, FUSED_PREFIX) if not math.isnan(pair[1])]
    if len(ranked) < 2:
        return ""
    text = ""
    for position, (method, value) in enumerate(ranked):
        same = position > 0 and value == ranked[position - 1][1]
        text += ("" if not position else " = " if same else " < ") + method.removeprefix(
            FUSED_PREFIX
        )
    return text


def findings(rows: Sequence[Row], metric: str) -> list[str]:
    """Sentences about one case: the order, and what fusion gains over a single camera.

    Args:
        rows: rows of one case and window.
        metric: the ranking metric; lower is better.
    """
    sentences = []
    title = column(metric).title
    if order_text := fusion_order(rows, metric):
        sentences.append(f"Fusion functions by {title}, best first: {order_text}.")
    common = f"common_{metric}"
    if common_text := fusion_order(rows, common):
        support = _value(rows, HARMONIC, "common_points")
        where = f"the {support} that all methods report" if support else "common pixels"
        sentences.append(f"On {where}: {common_text}.")
    single = [name for name, value in order(rows, metric, SINGLE_PREFIX) if not math.isnan(value)]
    fused = [name for name, _ in order(rows, metric, FUSED_PREFIX)]
    if HARMONIC in fused and single:
        sentences.append(_against(rows, HARMONIC, single[0], "the better single camera"))
    if causes_text := _causes(rows, HARMONIC):
        sentences.append(causes_text)
    return sentences


def _causes(rows: Sequence[Row], method: str) -> str:
    """Why a method's outliers are outliers, the largest share first; empty without any."""
    found = [row for row in rows if row.method == method and row.metric.startswith(CAUSE_PREFIX)]
    shares = sorted((row for row in found if row.value >= 0.5), key=lambda row: -row.value)
    if not shares:
        return ""
    parts = (f"{row.metric.removeprefix(CAUSE_PREFIX)} {row.value:.0f} %" for row in shares)
    names = ", ".join(parts).replace("_", " ")
    bad = shown(float(shares[0].points or 0), "px")
    return f"Why {bad} px of {method} are off by more than a tenth: {names}."


def _against(rows: Sequence[Row], method: str, other: str, role: str) -> str:
    parts = []
    for metric in ("mean_error", "bad_published", "points"):
        mine, theirs = _row(rows, method, metric), _row(rows, other, metric)
        if mine and theirs and not math.isnan(mine.value + theirs.value):
            title = column(metric).title
            parts.append(
                f"{title} {with_unit(mine)} against {with_unit(theirs)}{_change(mine, theirs)}"
            )
    return f"{method} beside {other}, {role}: {'; '.join(parts)}."


def _change(mine: Row, theirs: Row) -> str:
    if theirs.value == 0:
        return ""
    return f" ({100 * (mine.value / theirs.value - 1):+.0f} %)".replace("-", "−")


def _value(rows: Sequence[Row], method: str, metric: str) -> str:
    row = _row(rows, method, metric)
    return with_unit(row) if row else ""


def _row(rows: Sequence[Row], method: str, metric: str) -> Row | None:
    found = (row for row in rows if row.method == method and row.metric == metric)
    return next(found, None)
