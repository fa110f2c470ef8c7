"""Who is ahead: the order of the methods, tables with the best marked, and findings in words."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from eval.scoring.method_scores import ALL_METRICS, BAD_POINTS, CAUSE_PREFIX
from eval.scoring.metrics import Better
from eval.scoring.outlier_causes import CAUSES
from eval.scoring.regions import REGIONS
from eval.scoring.results import Row

FUSED_PREFIX = "Alg1/"
SINGLE_PREFIX = "EMVS/"
HARMONIC = "Alg1/H"
RANKING_COLUMNS = (
    "points",
    "completeness",
    "mean_error",
    "common_mean_error",
    "median_error",
    "rmse",
    "abs_rel",
    "silog",
    "bad_published",
    "outlier_share",
    "delta_1",
    "f1_5cm",
)
DIRECTIONS = {"lower": "lower is better", "higher": "higher is better", "none": "no better end"}
_SINGLE = re.compile(r"/cam\d+\b")
# Read in centimetres, stored in metres.
_SHOWN = {"m": ("cm", 100.0)}
_CONTEXT = {
    "truth_points": ("ground truth", "number of pixels with g"),
    BAD_POINTS: ("outlier points", "number of pixels with |e - g| / g > 0.10"),
    "baseline_focal": ("baseline x focal length", "b f"),
}


@dataclass(frozen=True, slots=True)
class Column:
    """A metric as a table's heading."""

    name: str
    title: str
    unit: str
    better: Better
    formula: str


@dataclass(frozen=True, slots=True)
class RankingCell:
    """One value of a table: as read, as sorted, and whether no other is better."""

    text: str
    value: float
    best: bool


@dataclass(frozen=True, slots=True)
class RankingLine:
    """One method of a table; `rank` counts the methods that use more than a single camera.

    Methods of the same value share a rank; one without a value has none.
    """

    method: str
    rank: int | None
    cells: tuple[RankingCell, ...]


@dataclass(frozen=True, slots=True)
class RankingTable:
    """Methods by metrics, in order of the ranking metric."""

    columns: tuple[Column, ...]
    lines: tuple[RankingLine, ...]


def column(name: str) -> Column:
    """The heading of a metric, with the unit in which tables show it."""
    if name in _CONTEXT:
        title, formula = _CONTEXT[name]
        return Column(name, title, "px·m" if name == "baseline_focal" else "px", "none", formula)
    if name.startswith(CAUSE_PREFIX):
        cause = name.removeprefix(CAUSE_PREFIX)
        title = f"outliers: {cause.replace('_', ' ')}"
        return Column(name, title, "%", "none", f"share of the outliers: {CAUSES[cause]}")
    region = _region(name)
    metric = ALL_METRICS[name.removeprefix(f"{region}_")]
    unit, _ = _SHOWN.get(metric.unit, (metric.unit, 1.0))
    unit = unit.replace("x100", "×100")
    if not region:
        return Column(name, metric.title, unit, metric.better, metric.formula)
    formula = f"{metric.formula}, over {REGIONS[region]}"
    return Column(name, f"{metric.title}, {region}", unit, metric.better, formula)


def _region(name: str) -> str:
    """The region that a metric's name begins with; empty for all pixels."""
    if name in ALL_METRICS:
        return ""
    return next(region for region in REGIONS if name.startswith(f"{region}_"))


def heading(name: str) -> str:
    """A metric's title; of one that is none of ours, its name."""
    try:
        return column(name).title
    except (KeyError, StopIteration):
        return name


def definition(name: str) -> str:
    """What a metric is and which end of it is better, as a line above its table."""
    found = column(name)
    unit = f", in {found.unit}" if found.unit else ""
    letters = " e is the estimate, g the truth." if re.search(r"\bg\b", found.formula) else ""
    title = found.title[:1].upper() + found.title[1:]
    return f"{title}: {found.formula}{unit}; {DIRECTIONS[found.better]}.{letters}"


def order(rows: Iterable[Row], metric: str, prefix: str = "") -> list[tuple[str, float]]:
    """Methods with their value of a metric, the best first; those without a value last.

    Args:
        rows: rows of one case and window.
        metric: name of the metric.
        prefix: only methods that begin so.
    """
    found = [row for row in rows if row.metric == metric and row.method.startswith(prefix)]
    return [(row.method, row.value) for row in sorted(found, key=_badness)]


def table(rows: Sequence[Row], metric: str, names: Sequence[str] = RANKING_COLUMNS) -> RankingTable:
    """Tabulates the rows of one case and window, ordered by a metric, the best of each marked."""
    by_method: dict[str, dict[str, Row]] = defaultdict(dict)
    for row in rows:
        by_method[row.method][row.metric] = row
    present = [name for name in names if any(name in found for found in by_method.values())]
    best = {name: best_value(row for row in rows if row.metric == name) for name in present}
    ranked = order(rows, metric)
    fused = [value for method, value in ranked if not _SINGLE.search(method)]
    lines = []
    for method, value in ranked:
        cells = tuple(_cell(by_method[method].get(name), best[name]) for name in present)
        # The first of equal values is the one that counts; NaN equals nothing.
        counts = not _SINGLE.search(method) and not math.isnan(value)
        lines.append(RankingLine(method, fused.index(value) + 1 if counts else None, cells))
    return RankingTable(tuple(column(name) for name in present), tuple(lines))


def _cell(row: Row | None, best: float) -> RankingCell:
    if row is None:
        return RankingCell("–", math.nan, False)
    return RankingCell(shown(row.value, row.unit), row.value, row.value == best)


def best_value(rows: Iterable[Row]) -> float:
    """The best of comparable rows; NaN where there is none or no direction."""
    found = [row for row in rows if not math.isnan(row.value) and row.better != "none"]
    return min(found, key=_badness).value if found else math.nan


def _badness(row: Row) -> tuple[bool, float]:
    return math.isnan(row.value), -row.value if row.better == "higher" else row.value


def mean_over_cases(rows: Sequence[Row], label: str) -> list[Row]:
    """Averages each method and metric over cases, every case weighing the same.

    A method that lacks a case has no mean: one over fewer cases would not be comparable.
    """
    cases = {row.case for row in rows}
    groups: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        groups[row.method, row.metric].append(row)
    return [_mean(found, len(cases), label) for found in groups.values()]


def _mean(rows: Sequence[Row], cases: int, label: str) -> Row:
    value = sum(row.value for row in rows) / cases if len(rows) == cases else math.nan
    return replace(rows[0], case=label, value=value)


def shown(value: float, unit: str) -> str:
    """A value as tables print it: metres as centimetres, counts with thin spaces."""
    if math.isnan(value):
        return "–"
    if unit == "px":
        return thousands(value)
    _, factor = _SHOWN.get(unit, (unit, 1.0))
    return f"{factor * value:.2f}"


def thousands(count: float) -> str:
    """A count with a thin space between thousands, without decimals."""
    return f"{count:,.0f}".replace(",", "\u202f")


def with_unit(row: Row) -> str:
    """A value and its unit as text prints them."""
    unit, _ = _SHOWN.get(row.unit, (row.unit, 1.0))
    return f"{shown(row.value, row.unit)} {unit}"


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
