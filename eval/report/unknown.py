"""Why a number of a method is not known, in words: a dash alone would leave its reader to guess."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from eventsweep.eval.results.table import each
from eventsweep.eval.scoring.curves import COVERAGE_METRICS
from eventsweep.eval.scoring.pairing import COMMON, EQUAL, HARMONIC, REFERENCE, SHARED

if TYPE_CHECKING:
    import pandas as pd

_OF_COVERAGE = {metric.name for metric in COVERAGE_METRICS}
_TOP = re.compile(r"mean_error_top_(\d+)pct")


def why_unknown(method: str, metric: str, own: Mapping[str, float]) -> str:
    """The reason why a metric is missing or NaN among a method's own numbers of one place."""
    if "points" not in own:
        return "was not scored everywhere"
    if not own["points"]:
        return "reports no pixel with truth"
    if (metric in _OF_COVERAGE or metric.startswith(f"{EQUAL}_")) and _is_unsure(own):
        return "brings no confidence"
    share = _TOP.fullmatch(metric)
    if share and own.get("completeness", math.inf) < int(share[1]):
        return f"covers less than {share[1]} % of the truth"
    if metric.startswith(f"{COMMON}_") and not own.get(f"{COMMON}_points", 1):
        return "no pixel is common to all methods"
    if metric.startswith((f"{SHARED}_", f"{HARMONIC}_")) and method == REFERENCE:
        return "is what others are compared with"
    return "is undefined there" if metric in own else "was not scored by it"


def _is_unsure(own: Mapping[str, float]) -> bool:
    """Whether errors are known, but not which are those of the surest pixels."""
    known = math.isfinite(own.get("mean_error", math.nan))
    return known and math.isnan(own.get("aurc", 0.0))


def unknown_words(
    rows: pd.DataFrame, methods: Sequence[str], metrics: Mapping[str, str],
    places: Sequence[tuple[str, int]],
) -> str:  # fmt: skip
    """Which numbers of methods are not known, and why; empty where all are.

    Args:
        rows: with `case`, `seed`, `method`, `metric` and `value`.
        methods: of a table.
        metrics: its columns' titles by metric.
        places: its cases and seeds.
    """
    found: dict[tuple[str, str], list[str]] = {}
    of_method = {str(name): part for name, part in rows.groupby("method", sort=False)}
    for method in methods:
        for metric, why in _gaps(method, of_method[method], list(metrics), places):
            found.setdefault((metrics[metric], why), []).append(method)
    return "; ".join(
        f"{title} of {', '.join(names)} ({why})" for (title, why), names in found.items()
    )


def _gaps(
    method: str, rows: pd.DataFrame, metrics: Sequence[str], places: Sequence[tuple[str, int]]
) -> Iterator[tuple[str, str]]:
    """Metrics that a method lacks somewhere, with the reason at the first such place."""
    at: dict[tuple[str, int], dict[str, float]] = {place: {} for place in places}
    for row in each(rows):
        if (row.case, row.seed) in at:
            at[row.case, row.seed][row.metric] = row.value
    for metric in metrics:
        lacking = (own for own in at.values() if math.isnan(own.get(metric, math.nan)))
        own = next(lacking, None)
        if own is not None:
            yield metric, why_unknown(method.rpartition(": ")[2], metric, own)


def unsure_words(rows: pd.DataFrame) -> str:
    """Which methods of one case and window bring no confidence, and what is not known for that."""
    own: dict[str, dict[str, float]] = {}
    for row in each(rows):
        own.setdefault(row.method, {})[row.metric] = row.value
    unsure = [method for method, numbers in own.items() if _is_unsure(numbers)]
    if not unsure:
        return ""
    verb = "brings" if len(unsure) == 1 else "bring"
    return (
        f"{', '.join(unsure)} {verb} no confidence: which pixels are the surest is not known, nor "
        "errors of those and, beside a method of fewer points, at equal points."
    )
