"""Who is ahead: the order of the methods, tables with the best marked, and findings in words."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd

from eventsweep.emvs.errors import InputError
from eventsweep.eval.figures.colormaps import line_style
from eventsweep.eval.found_poses import TRACK, is_on_own_poses, method_on_own_poses
from eventsweep.eval.numbers import display_unit, displayed
from eventsweep.eval.report.html import Grid, GridCell, Head, grid
from eventsweep.eval.report.unknown import unsure_words
from eventsweep.eval.results.direction import Direction, badness, best
from eventsweep.eval.results.table import RIG, each, tidy
from eventsweep.eval.scoring.method_scores import ALL_METRICS, BAD_POINTS, CAUSE_PREFIX
from eventsweep.eval.scoring.metrics import PRIMARY_OF_GEOMETRIES, SURFACES
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.scoring.pairing import COMPARED, HARMONIC, REFERENCE, SHARED
from eventsweep.eval.scoring.predictions import FAMILY
from eventsweep.eval.scoring.regions import REGIONS
from eventsweep.eval.scoring.score import BASELINE, TRAVEL
from eventsweep.eval.scoring.standings import Standing, standings
from eventsweep.eval.scoring.trajectories.metrics import PRIMARY_OF_TRAJECTORIES, metric_named

FUSED_PREFIX = "Alg1/"
SINGLE_PREFIX = "EMVS/"
RANKING_COLUMNS = (
    "points", "completeness", "recall_5cm", "mean_error", "common_mean_error", "equal_mean_error",
    "median_error",
    "rmse", "abs_rel", "silog", "bad_published", "outlier_share", "delta_1", "f1_5cm",
    *PRIMARY_OF_TRAJECTORIES, "ate_share", "drift_rotation", "scale_error",
    *PRIMARY_OF_GEOMETRIES, "chamfer",
)  # fmt: skip
_OF_POSES = ("time_covered", "ate_rmse", "ate_share", "drift", "ate_rotation_rmse")
_ARROWS = {"lower": "↓", "higher": "↑", "none": ""}
DIRECTIONS = {"lower": "lower is better", "higher": "higher is better", "none": "no better end"}
_SINGLE = re.compile(r"/cam\d+\b")
_CONTEXT = {
    "truth_points": ("ground truth", "px", "number of pixels with g"),
    BAD_POINTS: ("outlier points", "px", "number of pixels with |e - g| / g > 0.10"),
    "baseline_focal": ("baseline x focal length", "px·m", "b f"),
    BASELINE: ("baseline", "cm", "distance between the first two cameras"),
    TRAVEL: ("lateral travel", "cm", "how far camera 0 moves across its view in a window"),
}
_REGIONS = REGIONS | COMPARED | SURFACES


@dataclass(frozen=True, slots=True)
class Column:
    """A metric as a table's heading."""

    name: str
    title: str
    unit: str
    direction: Direction
    formula: str

    def head(self, title: str = "") -> Head:
        """A heading of values of the metric."""
        return Head(title or self.title, self.unit, self.direction, arrow=True, about=self.formula)


@dataclass(frozen=True, slots=True)
class RankingLine:
    """One method of a table; without standings, or a number of every case and seed, no rank."""

    method: str
    rank: int | None
    cells: tuple[GridCell, ...]


@dataclass(frozen=True, slots=True)
class RankingTable:
    """Methods by metrics, in order of their ranks or of the ranking metric."""

    columns: tuple[Column, ...]
    lines: tuple[RankingLine, ...]
    metric: str

    def heads(self) -> list[Head]:
        """The columns' headings on a page."""
        return [column.head() for column in self.columns]

    def grid(self, about: str = "", spreads: Mapping[tuple[str, str], str] | None = None) -> Grid:
        """The table of a page; `spreads` by method and metric stand behind their values."""
        names = [column.name for column in self.columns]
        ranked = any(line.rank for line in self.lines)
        lines = tuple(
            (
                named_cell(line.method),
                *([rank_cell(line)] if ranked else []),
                *(
                    with_spread(cell, (spreads or {}).get((line.method, name), "–"))
                    for name, cell in zip(names, line.cells, strict=True)
                ),
            )
            for line in self.lines
        )
        heads = (Head("method", text=True), *([Head("rank")] if ranked else []), *self.heads())
        ordered_by = 1 + names.index(self.metric) if self.metric in names else -1
        ordered_by = 1 if ranked else ordered_by
        return Grid(heads, lines, about, ordered_by)

    def by_metric(self) -> Grid:
        """A line for each metric instead, with a column for each method: values do not sort."""
        lines = (
            (
                GridCell(f"{head.title} {_ARROWS[head.direction]}".strip(), about=head.formula),
                head.unit,
                *(replace(line.cells[k], value=math.nan) for line in self.lines),
            )
            for k, head in enumerate(self.columns)
        )
        return grid(("metric", "unit", *(Head(line.method) for line in self.lines)), lines)


def rank_cell(line: RankingLine) -> GridCell:
    """A method's rank, "–" where it has none."""
    return GridCell(str(line.rank or "–"), line.rank or math.nan)


def named_cell(method: str) -> GridCell:
    """A method with the colour that it is drawn in."""
    return GridCell(method, colour=line_style(method).css)


def with_spread(cell: GridCell, spread: str) -> GridCell:
    """A value and, where it is known, how much it varies."""
    return cell if spread == "–" else replace(cell, text=f"{cell.text} ± {spread}")


def column(name: str) -> Column:
    """The heading of a metric, with the unit in which tables show it."""
    if name in _CONTEXT:
        title, unit, formula = _CONTEXT[name]
        return Column(name, title, unit, "none", formula)
    if name.startswith(CAUSE_PREFIX):
        cause = name.removeprefix(CAUSE_PREFIX)
        title = f"outliers: {cause.replace('_', ' ')}"
        return Column(name, title, "%", "none", f"share of the outliers: {CAUSES[cause]}")
    region = _region(name)
    metric = metric_named(name.removeprefix(f"{region}_"))
    unit = display_unit(metric.unit).replace("x100", "×100")
    if not region:
        return Column(name, metric.title, unit, metric.direction, metric.formula)
    formula = f"{metric.formula}, over {_REGIONS[region]}"
    return Column(name, f"{metric.title}, {region}", unit, metric.direction, formula)


def _region(name: str) -> str:
    """The region that a metric's name begins with; empty for all pixels."""
    if name in ALL_METRICS:
        return ""
    return next((region for region in _REGIONS if name.startswith(f"{region}_")), "")


def heading(name: str) -> str:
    """A metric's title; of one that is none of ours, its name."""
    try:
        return column(name).title
    except InputError:
        return name


def definition(name: str) -> str:
    """What a metric is and which end of it is better, as a line above its table."""
    head = column(name)
    unit = f", in {head.unit}" if head.unit else ""
    letters = " e is the estimate, g the truth." if re.search(r"\bg\b", head.formula) else ""
    title = head.title[:1].upper() + head.title[1:]
    return f"{title}: {head.formula}{unit}; {DIRECTIONS[head.direction]}.{letters}"


def order(rows: pd.DataFrame, metric: str, prefix: str = "") -> list[tuple[str, float]]:
    """Methods that begin with `prefix`, the best by a metric first; those without a value last.

    Rows are those of one case and window.
    """
    found = rows[(rows["metric"] == metric) & rows["method"].str.startswith(prefix)]
    ordered = sorted(each(found), key=lambda row: badness(row.value, row.direction))
    return [(row.method, row.value) for row in ordered]


def ranked_methods(rows: pd.DataFrame, metric: str) -> list[str]:
    """Methods that use more than a single camera, the best first: what a picture shows."""
    found = order(rows, metric)
    return [name for name, value in found if not (math.isnan(value) or _SINGLE.search(name))]


def standings_of(rows: pd.DataFrame, metric: str) -> tuple[Standing, ...]:
    """Ranks by one metric, of the methods that have a row of it for every case and seed.

    The rows are of one window, of any number of cases and seeds.
    """
    rows = rows[rows["metric"] == metric]
    if rows.empty:
        return ()
    found: dict[str, dict[tuple[str, int], float]] = {}
    for row in each(rows.assign(seed=rows["seed"].fillna(0).astype(int))):
        found.setdefault(row.method, {})[row.case, row.seed] = row.value
    cases: dict[str, list[tuple[str, int]]] = {}
    for place in dict.fromkeys(place for of in found.values() for place in of):
        cases.setdefault(place[0], []).append(place)
    values = {
        method: [[of[place] for place in places] for places in cases.values()]
        for method, of in found.items()
        if all(place in of for places in cases.values() for place in places)
    }
    return standings(values, rows["direction"].iloc[0])


def table(
    rows: pd.DataFrame, metric: str, names: Sequence[str] = RANKING_COLUMNS,
    ranks: Sequence[Standing] = (),
) -> RankingTable:  # fmt: skip
    """Tabulates the rows of one case and window, the best of each metric marked.

    Methods are in the order of their ranks, and others behind them in that of a metric.
    What has no row of that metric, such as poses beside depth maps, is not in it.
    """
    rows = rows[rows["method"].isin(rows.loc[rows["metric"] == metric, "method"])]
    of_metric = {name: list(each(found)) for name, found in rows.groupby("metric", sort=False)}
    present = [name for name in names if name in of_metric]
    columns = {name: {row.method: row for row in of_metric[name]} for name in present}
    top = {
        name: best((row.value for row in found.values()), next(iter(found.values())).direction)
        for name, found in columns.items()
    }
    by_method = {one.method: one.rank for one in ranks}
    lines = []
    for method in dict.fromkeys((*by_method, *(name for name, _ in order(rows, metric)))):
        cells = tuple(_cell(columns[name].get(method), top[name]) for name in present)
        lines.append(RankingLine(method, by_method.get(method), cells))
    return RankingTable(tuple(column(name) for name in present), tuple(lines), metric)


def _cell(row: Any, top: float) -> GridCell:
    return GridCell("–") if row is None else value_cell(row.value, row.unit, top)


def value_cell(value: float, unit: str, top: float) -> GridCell:
    """A value as tables show it, marked where it is that of the best."""
    return GridCell(displayed(value, unit), value, "best" if value == top else "")


def mean_over_cases(rows: pd.DataFrame, label: str) -> pd.DataFrame:
    """Averages each method and metric over cases, every case weighing the same.

    A method that lacks a case has no mean: one over fewer cases would not be comparable. Pixels
    are added up. Intervals of single cases are none of their mean.
    """
    cases = rows["case"].nunique()
    means: list[dict[str, Any]] = []
    for _, found in rows.groupby(["method", "metric"], sort=False):
        value = sum(found["value"]) / cases if len(found) == cases else math.nan
        support = found["support"].sum(skipna=False)
        about = {"case": label, "value": value, "support": support, "low": None, "high": None}
        means.append({**next(each(found))._asdict(), **about})
    return tidy(means)


def with_unit(row: Any) -> str:
    """A value and its unit as text prints them."""
    return f"{displayed(row.value, row.unit)} {display_unit(row.unit)}"


def findings(rows: pd.DataFrame, metric: str, cases: int = 1) -> list[str]:
    """Sentences about one case: the order, and what fusion gains over a single camera.

    Two methods are compared on the pixels that both report; the number of those pixels is given.
    The rows are of one case and window, or the mean of `cases`; a lower value of the metric wins.
    """
    said = _Findings({(row.method, row.metric): row for row in each(rows)}, cases)
    poses = said.poses(rows, metric)
    rows = rows[~rows["method"].map(is_on_own_poses).astype(bool)]
    sentences = []
    names = fusion_order(rows, metric)
    if names:
        head = column(metric)
        values = said.fusion(names, metric)
        sentences.append(f"Fusion functions by {head.title} [{head.unit}], best first: {values}.")
    if names and (values := said.fusion(names, f"common_{metric}")):
        support = said.count(REFERENCE, "common_points")
        where = f"the {support} that all methods report" if support else "common pixels"
        sentences.append(f"In the same order, on {where}: {values}.")
    ranked = [name for name, value in order(rows, metric) if not math.isnan(value)]
    single = next((name for name in ranked if name.startswith(SINGLE_PREFIX)), None)
    if REFERENCE in ranked:
        if single is not None:
            sentences.append(said.beside(REFERENCE, single, "the better single camera"))
        sentences += [said.beside(name, REFERENCE) for name in _others(ranked)]
        if single is not None and ranked.index(single) < ranked.index(REFERENCE):
            sentences.append(said.why_single(single, metric))
    if unsure := unsure_words(rows):
        sentences.append(unsure)
    if causes_text := said.causes(REFERENCE):
        sentences.append(causes_text)
    return sentences + poses


def _others(ranked: Sequence[str]) -> list[str]:
    """Predictions, and the best method of all, where it is neither fused so nor a single camera."""
    best = next(name for name in ranked if not _SINGLE.search(name))
    ours = best.startswith((FUSED_PREFIX, SINGLE_PREFIX))
    return [name for name in ranked if name.startswith(FAMILY) or (name == best and not ours)]


def fusion_order(rows: pd.DataFrame, metric: str) -> list[str]:
    """The fusion functions from best to worst, those with a value; empty below two."""
    ranked = [name for name, value in order(rows, metric, FUSED_PREFIX) if not math.isnan(value)]
    return [name.removeprefix(FUSED_PREFIX) for name in ranked] if len(ranked) > 1 else []


@dataclass(frozen=True)
class _Findings:
    """Sentences about the numbers of one case, or of the mean of several."""

    rows: dict[tuple[str, str], Any]
    cases: int

    def fusion(self, names: Sequence[str], metric: str) -> str:
        """The values of fusion functions in one order, whatever the metric; empty without any."""
        found = [(name, self.rows.get((FUSED_PREFIX + name, metric))) for name in names]
        return ", ".join(f"{name} {displayed(row.value, row.unit)}" for name, row in found if row)

    def beside(self, method: str, other: str, role: str = "") -> str:
        partner = other if method == REFERENCE else method
        regions = (HARMONIC, SHARED) if method == REFERENCE else (SHARED, HARMONIC)
        mine, theirs = ((partner, f"{region}_") for region in regions)
        support = self.count(partner, f"{SHARED}_points")
        names = f"{method} beside {other}{f', {role}' if role else ''}"
        own = self._against((method, ""), (other, ""), ("mean_error", "points"))
        if not support:  # scored before pairs were
            return f"{names}, each on its own pixels: {own}."
        both = self._against(mine, theirs, ("mean_error", "bad_published"))
        on_both = f"on the {support} that both report: {both}; " if both else "no pixel in common; "
        return f"{names}, {on_both}each on its own pixels: {own}."

    def _against(
        self, mine: tuple[str, str], theirs: tuple[str, str], metrics: Sequence[str]
    ) -> str:
        """Numbers of two (method, prefix of the metric's name), and by how much they differ."""
        parts = []
        for metric in metrics:
            first, second = (self.rows.get((one[0], one[1] + metric)) for one in (mine, theirs))
            if first and second and not math.isnan(first.value + second.value):
                values = f"{with_unit(first)} against {with_unit(second)}{_change(first, second)}"
                parts.append(f"{column(metric).title} {values}")
        return "; ".join(parts)

    def why_single(self, single: str, metric: str) -> str:
        """Why a single camera is ahead of fusion: as far as the numbers say."""
        reasons = [self._by_pixels(single), self._by_partner(single, metric), self._by_parallax()]
        known = [reason for reason in reasons if reason]
        reason = "; ".join(known) if known else "these numbers do not show why"
        return f"{single} is ahead of {REFERENCE} by {column(metric).title}: {reason}."

    def _by_pixels(self, single: str) -> str:
        mine, theirs = (self.rows.get((single, f"{r}_mean_error")) for r in (SHARED, HARMONIC))
        support = self.count(single, f"{SHARED}_points")
        if not (mine and theirs and support) or math.isnan(mine.value + theirs.value):
            return ""
        if mine.value >= theirs.value:
            return f"it reports other pixels, and is not ahead on the {support} that both report"
        return f"not by its choice of pixels: it is also ahead on the {support} that both report"

    def _by_partner(self, single: str, metric: str) -> str:
        """Fusion needs every camera: one that is worse alone costs it."""
        fused = self.rows[REFERENCE, metric].value
        others = [
            row
            for (name, one), row in self.rows.items()
            if one == metric and name.startswith(SINGLE_PREFIX) and name != single
        ]
        worse = [row for row in others if row.value > fused]
        return "; ".join(
            f"{row.method} alone is worse than {REFERENCE} ({with_unit(row)}), and fusion needs "
            "rays of every camera to meet"
            for row in worse
        )

    def _by_parallax(self) -> str:
        travel, baseline = self.rows.get((RIG, TRAVEL)), self.rows.get((RIG, BASELINE))
        if not (travel and baseline) or not travel.value >= baseline.value:
            return ""
        each = "in a window" if self.cases == 1 else "in a window, on average,"
        return (
            f"camera 0 moves {with_unit(travel)} sideways {each} and the cameras are "
            f"{with_unit(baseline)} apart: its own motion gives it as much parallax as a second "
            "camera would"
        )

    def causes(self, method: str) -> str:
        """Why a method's outliers are outliers, the largest share first; empty without any."""
        found = [
            row
            for (name, metric), row in self.rows.items()
            if name == method and metric.startswith(CAUSE_PREFIX) and row.value >= 0.5
        ]
        if not found:
            return ""
        shares = sorted(found, key=lambda row: -row.value)
        parts = (f"{row.metric.removeprefix(CAUSE_PREFIX)} {row.value:.0f} %" for row in shares)
        names = ", ".join(parts).replace("_", " ")
        bad = displayed(float(shares[0].support), "px")
        where = "" if self.cases == 1 else f" in {self.cases} cases"
        mean = "" if self.cases == 1 else " (mean of the cases)"
        return f"Why {bad} px of {method}{where} are off by more than a tenth{mean}: {names}."

    def poses(self, rows: pd.DataFrame, metric: str) -> list[str]:
        """How good poses are that were found from events, and how maps on them compare."""
        numbers = [self.rows.get((TRACK, name)) for name in _OF_POSES]
        known = [row for row in numbers if row and not math.isnan(row.value)]
        if not known:
            return []
        texts = ", ".join(f"{column(row.metric).title} {with_unit(row)}" for row in known)
        changes = [
            f"{name}{_change(self.rows[own, metric], self.rows[name, metric])}"
            for name, value in order(rows, metric)
            if ((own := method_on_own_poses(name)), metric) in self.rows and not math.isnan(value)
        ]
        beside = f" {column(metric).title} on them: {', '.join(changes)}." if changes else ""
        return [f"Poses found from events: {texts}.{beside[:2].upper()}{beside[2:]}"]

    def count(self, method: str, metric: str) -> str:
        row = self.rows.get((method, metric))
        if row is None or math.isnan(row.value):
            return ""
        return with_unit(row) if self.cases == 1 else f"{with_unit(row)} a case"


def _change(mine: Any, theirs: Any) -> str:
    if theirs.value == 0:
        return ""
    return f" ({100 * (mine.value / theirs.value - 1):+.0f} %)".replace("-", "−")
