"""The table of a paper: methods by metrics over cases and seeds, with intervals, and who wins.

A cell is the mean over cases, which weigh the same, of the mean over a case's seeds. Its interval
is Student's t over seeds with cases as strata (`eval.scoring.significance.stratified_interval`):
cases are chosen, seeds are drawn. Beside a reference, differences are taken between numbers of the
same case and seed, so that what a seed does to both falls out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, check_path, quoted
from eventsweep.emvs.utils.outputs import output_file
from eventsweep.eval.numbers import display_unit, displayed
from eventsweep.eval.report.ranking import column
from eventsweep.eval.report.unknown import unknown_words
from eventsweep.eval.results.direction import Direction, best, change_of
from eventsweep.eval.results.results import Results
from eventsweep.eval.results.table import EVENTS, POOLED, RIG
from eventsweep.eval.scoring.significance import stratified_interval

if TYPE_CHECKING:
    import pandas as pd

METRICS = ("mean_error", "median_error", "bad_published", "points")
"""The columns unless others are chosen, as far as there are such numbers."""
_ARROWS = {"lower": "↓", "higher": "↑", "none": ""}
_TEX_ARROWS = {"lower": r" $\downarrow$", "higher": r" $\uparrow$", "none": ""}
_TEX_SIGNS = str.maketrans({
    "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}",
    "·": r"$\cdot$", "×": r"$\times$", "°": r"$^\circ$", "–": "--", "±": r"$\pm$", "−": "$-$",
})  # fmt: skip


class Estimate(NamedTuple):
    """A mean and the ends of its 95 % interval, which are NaN where there are too few seeds."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class Cell:
    """One method and metric.

    Attributes:
        value: over all cases and seeds; NaN where the method lacks one of them.
        difference: from the reference, of pairs; None without one, and of the reference itself.
        wins: in how many of `pairs`, those that have both numbers, it beats the reference.
        is_best: whether no method of the table has a better mean.
    """

    value: Estimate
    difference: Estimate | None = None
    wins: int = 0
    pairs: int = 0
    is_best: bool = False


class Head(NamedTuple):
    """A column's metric, and how it is shown."""

    metric: str
    title: str
    unit: str
    direction: Direction


@dataclass(frozen=True)
class MethodTable:
    """The table.

    Attributes:
        heads: the columns.
        lines: per method its cells.
        reference: the method that all are compared with; empty for none.
        cases, seeds: what the numbers are of.
        left_out: methods that lack a number of one of those.
        unknown: numbers of the other methods that are not known, and why; empty where all are.
    """

    heads: tuple[Head, ...]
    lines: Mapping[str, tuple[Cell, ...]]
    reference: str
    cases: tuple[str, ...]
    seeds: tuple[int, ...]
    left_out: tuple[str, ...] = ()
    unknown: str = ""

    @property
    def caption(self) -> str:
        """What the numbers are, in a sentence."""
        seeds = f"{len(self.seeds)} seed{'s' * (len(self.seeds) != 1)}"
        words = f"Mean over {len(self.cases)} case{'s' * (len(self.cases) != 1)} and {seeds}"
        if len(self.seeds) > 1:
            words += ", with 95 % intervals (Student's t over seeds, cases as strata)"
        words += "; bold: best mean of its column"
        if self.reference:
            words += f"; Δ: paired difference from {self.reference}, and in how many pairs it wins"
        if self.unknown:
            words += f"; not known: {self.unknown}"
        if self.left_out:
            words += f"; left out, for they lack some of it: {', '.join(self.left_out)}"
        return f"{words}."


def method_table(
    results: Mapping[str, Results], metrics: Sequence[str] = (), reference: str = "",
    cases: Sequence[str] = (),
) -> MethodTable:  # fmt: skip
    """Tabulates the methods of one result, or of several, each under its name.

    Args:
        results: by name; with several, a method is called `NAME: METHOD`.
        metrics: the columns; by default those of `METRICS` that are there.
        reference: a method as the table calls it; all others are compared with it in pairs.
        cases: the ones to take; by default those that the reference has, or the first method.

    Raises:
        InputError: a metric, reference or case that no result has, or results of no common case and
            seed.
    """
    rows = _numbers(results)
    known = set(rows["metric"])
    chosen = metrics or [metric for metric in METRICS if metric in known] or METRICS[:1]
    heads = tuple(_head(rows, metric) for metric in chosen)
    _check_known("method", (reference,) if reference else (), rows["method"])
    _check_known("case", cases, rows["case"])
    places = _places(rows, heads[0].metric, reference or rows["method"].iloc[0], cases)
    grids = [_grid(rows, head.metric, places) for head in heads]
    whole = [set(grid.index[grid.notna().all(axis=1)]) for grid in grids]
    every = tuple(dict.fromkeys(rows["method"]))
    methods = [method for method in every if any(method in names for names in whole)]
    columns = [
        _column(grid, methods, head.direction, reference)
        for grid, head in zip(grids, heads, strict=True)
    ]
    lines = {method: tuple(of[method] for of in columns) for method in methods}
    its_cases, seeds = (tuple(dict.fromkeys(part)) for part in zip(*places, strict=True))
    left_out = tuple(method for method in every if method not in lines)
    unknown = unknown_words(rows, methods, {head.metric: head.title for head in heads}, places)
    return MethodTable(heads, lines, reference, its_cases, seeds, left_out, unknown)


def _check_known(what: str, names: Sequence[str], column: pd.Series) -> None:
    known = dict.fromkeys(column)
    for name in names:
        if name not in known:
            raise InputError(f"no {what} {name!r} in the results: choose from {quoted(*known)}")


def _numbers(results: Mapping[str, Results]) -> pd.DataFrame:
    """The pooled rows of all methods, each of a case and a seed."""
    import pandas as pd

    tables = []
    for name, result in results.items():
        rows = result.rows[result.rows["window"] == POOLED]
        rows = rows[~rows["method"].isin((RIG, EVENTS))]
        rows = rows.assign(seed=rows["seed"].fillna(0).astype(int), result=name)
        prefix = f"{name}: " if len(results) > 1 else ""
        tables.append(rows.assign(method=prefix + rows["method"]))
    return pd.concat(tables, ignore_index=True)


def _head(rows: pd.DataFrame, metric: str) -> Head:
    of_metric = rows[rows["metric"] == metric]
    if of_metric.empty:
        known = quoted(*dict.fromkeys(rows["metric"]))
        raise InputError(f"no metric {metric!r} in the results: choose from {known}")
    try:
        title = column(metric).title
    except InputError:  # own results may have metrics of their own
        title = metric.replace("_", " ")
    return Head(metric, title, of_metric["unit"].iloc[0], of_metric["direction"].iloc[0])


def _places(
    rows: pd.DataFrame, metric: str, method: str, cases: Sequence[str]
) -> list[tuple[str, int]]:
    """Cases and seeds that a method has, and every result, in their order."""
    own = rows[(rows["method"] == method) & (rows["metric"] == metric)]
    everywhere = [
        set(zip(part["case"], part["seed"], strict=True))
        for _, part in rows.groupby("result", sort=False)
    ]
    common = [
        place
        for place in dict.fromkeys(zip(own["case"], own["seed"], strict=True))
        if all(place in places for places in everywhere) and (not cases or place[0] in cases)
    ]
    if not common:
        raise InputError(
            f"{method} has no case and seed that every result has: run the same suite for all"
        )
    return common


def _grid(rows: pd.DataFrame, metric: str, places: Sequence[tuple[str, int]]) -> pd.DataFrame:
    """Methods by cases and seeds; NaN where there is no number."""
    import pandas as pd

    of_metric = rows[rows["metric"] == metric]
    grid = of_metric.pivot_table(
        index="method", columns=["case", "seed"], values="value", sort=False, dropna=False
    )
    return grid.reindex(columns=pd.MultiIndex.from_tuples(places, names=["case", "seed"]))


def _column(
    grid: pd.DataFrame, methods: Sequence[str], direction: Direction, reference: str
) -> dict[str, Cell]:
    of_cases = [str(case) for case in grid.columns.get_level_values("case")]
    values = {method: grid.reindex([method]).to_numpy(np.float64)[0] for method in methods}
    means = {method: _estimate(numbers, of_cases) for method, numbers in values.items()}
    top = best((estimate.mean for estimate in means.values()), direction)
    # Nobody is best of what is the same for all.
    differ = len({estimate.mean for estimate in means.values()}) > 1 or len(means) == 1
    cells = {}
    for method, estimate in means.items():
        cell = Cell(estimate, is_best=differ and estimate.mean == top)
        if reference and method != reference:
            differences = values[method] - values[reference]
            known = differences[np.isfinite(differences)]
            changes = [change_of(float(change), direction) for change in known]
            cell = replace(
                cell, difference=_estimate(differences, of_cases),
                wins=changes.count("better"), pairs=len(changes),
            )  # fmt: skip
        cells[method] = cell
    return cells


def _estimate(values: NDArray[np.float64], of_cases: Sequence[str]) -> Estimate:
    """Of a number per case and seed; cases are strata."""
    at = np.array(of_cases)
    strata = [values[at == case] for case in dict.fromkeys(of_cases)]
    mean = float(np.mean([np.mean(stratum) for stratum in strata]))
    return Estimate(mean, *stratified_interval(strata))


def _shown(estimate: Estimate, unit: str, *, sign: bool = False) -> str:
    """A mean, and half its interval, which is symmetric."""
    if math.isnan(estimate.mean):
        return "–"
    mean = displayed(estimate.mean, unit).replace("-", "−")  # no hyphen
    mean = f"+{mean}" if sign and estimate.mean > 0 else mean
    half = estimate.high - estimate.mean
    return mean if math.isnan(half) else f"{mean} ± {displayed(half, unit)}"


def _texts(table: MethodTable, cells: Sequence[Cell]) -> list[tuple[str, bool]]:
    """The texts of a line, and whether each is that of the best."""
    texts: list[tuple[str, bool]] = []
    for head, cell in zip(table.heads, cells, strict=True):
        texts.append((_shown(cell.value, head.unit), cell.is_best))
        if table.reference:
            texts.append((_against(cell, head), False))
    return texts


def _against(cell: Cell, head: Head) -> str:
    if cell.difference is None:
        return ""
    text = _shown(cell.difference, head.unit, sign=True)
    return (
        text if head.direction == "none" or not cell.pairs else f"{text} ({cell.wins}/{cell.pairs})"
    )


def markdown(table: MethodTable) -> str:
    """The table in Markdown, the best of each column bold."""
    heads = ["Method"]
    for head in table.heads:
        unit = display_unit(head.unit)
        heads.append(
            " ".join(filter(None, (head.title, unit and f"[{unit}]", _ARROWS[head.direction])))
        )
        heads += ["Δ"] * bool(table.reference)
    lines = [_row(heads), _row(["---", *["--:"] * (len(heads) - 1)])]
    for method, cells in table.lines.items():
        texts = (f"**{text}**" if bold else text for text, bold in _texts(table, cells))
        lines.append(_row([method.replace("|", "\\|"), *texts]))
    return "\n".join([*lines, "", table.caption, ""])


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def latex(table: MethodTable) -> str:
    """The table in LaTeX, for the package booktabs, the best of each column bold."""
    heads = ["Method"]
    for head in table.heads:
        unit = display_unit(head.unit).translate(_TEX_SIGNS)
        title = f"{head.title.translate(_TEX_SIGNS)}{f' [{unit}]' if unit else ''}"
        heads.append(title + _TEX_ARROWS[head.direction])
        heads += [r"$\Delta$"] * bool(table.reference)
    lines = [f"% {table.caption}", rf"\begin{{tabular}}{{l{'r' * (len(heads) - 1)}}}", r"\toprule"]
    lines += [_tex_row(heads), r"\midrule"]
    for method, cells in table.lines.items():
        texts = ((text.translate(_TEX_SIGNS), bold) for text, bold in _texts(table, cells))
        marked = [rf"\textbf{{{text}}}" if bold else text for text, bold in texts]
        lines.append(_tex_row([method.translate(_TEX_SIGNS), *marked]))
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _tex_row(cells: Sequence[str]) -> str:
    return rf"{' & '.join(cells)} \\"


def csv(table: MethodTable) -> str:
    """The numbers for programs, in their stored units, one method and metric a line."""
    import pandas as pd

    nothing = Estimate(math.nan, math.nan, math.nan)
    rows = [
        {
            "method": method, "metric": head.metric, "unit": head.unit,
            "direction": head.direction, **cell.value._asdict(), "reference": table.reference,
            **{f"difference_{k}": v for k, v in (cell.difference or nothing)._asdict().items()},
            "wins": cell.wins, "pairs": cell.pairs,
        }
        for method, cells in table.lines.items()
        for head, cell in zip(table.heads, cells, strict=True)
    ]  # fmt: skip
    return str(pd.DataFrame(rows).to_csv(index=False, lineterminator="\n"))


FORMATS: Mapping[str, Callable[[MethodTable], str]] = {".md": markdown, ".tex": latex, ".csv": csv}


def check_table_file(path: Path) -> None:
    """Refuses a file of another format than those of `FORMATS`, before anything runs."""
    if path.suffix not in FORMATS:
        raise InputError(f"{path}: a table needs a name that ends in {', '.join(FORMATS)}")


def write_table(path: str | Path, table: MethodTable, *, force: bool = False) -> None:
    """Writes the table in the format that the file's name says.

    Raises:
        InputError: another ending than those of `FORMATS`, or a file that is there, without force.
    """
    check_path("path", path)
    check_table_file(Path(path))
    with output_file(Path(path), force=force) as partial:
        partial.write_text(FORMATS[Path(path).suffix](table), encoding="utf-8")
