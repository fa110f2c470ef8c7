"""Tables and figures as files beside a page: CSV, LaTeX with booktabs, Markdown, SVG."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import matplotlib as mpl
from matplotlib.figure import Figure

from eventsweep.emvs.utils.outputs import files_together
from eventsweep.eval.figures.plots import (
    STYLE,
    causes_figure,
    curves_figure,
    outlier_causes,
    slice_figure,
)
from eventsweep.eval.report.html import Grid, GridCell, Head
from eventsweep.eval.report.ranking import (
    RankingTable,
    column,
    mean_over_cases,
    rank_cell,
    table,
)
from eventsweep.eval.report.run_data import CaseData, RunData, load_run
from eventsweep.eval.report.run_page import curves_of, with_predictions
from eventsweep.eval.results.table import POOLED, together

FORMATS = ("csv", "tex", "md")
_TEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"$<$", ">": r"$>$", "|": r"$|$", "–": "--", "−": "$-$",
    "δ": r"$\delta$", "×": r"$\times$", "↓": r"$\downarrow$", "↑": r"$\uparrow$", "Δ": r"$\Delta$",
    "·": r"$\cdot$", "±": r"$\pm$",
}  # fmt: skip
_ARROWS = {"lower": "↓", "higher": "↑"}
FigureFormat = Literal["svg", "pdf"]
TABLES_FOLDER, FIGURES_FOLDER = "tables", "figures"
# A file has no text around it to take its colour from; without dates, equal data give equal bytes.
_UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
_FILE_STYLE = {**STYLE, "savefig.facecolor": "white", "pdf.fonttype": 42}


def ranking_table(ranking: RankingTable, caption: str) -> Grid:
    """A ranking as a table of a file: units and directions in the headings, the best bold."""
    ranked = any(line.rank for line in ranking.lines)
    lines = (
        (GridCell(line.method), *([rank_cell(line)] if ranked else []), *line.cells)
        for line in ranking.lines
    )
    heads = (Head("method", text=True), *([Head("rank")] if ranked else []), *ranking.heads())
    return Grid(heads, tuple(lines), caption)


def in_unit(value: float, unit: str) -> float:
    """A stored value in the unit that tables show it in: metres become centimetres."""
    return float(f"{100 * value:.9g}") if unit == "cm" else value


def _headings(table: Grid) -> list[str]:
    parts = (
        (head.title, head.unit and f"[{head.unit}]", head.arrow and _ARROWS.get(head.direction))
        for head in table.heads
    )
    return [" ".join(part for part in head if part) for head in parts]


def write_tables(folder: Path, tables: dict[str, Grid]) -> list[Path]:
    """Writes NAME.csv, NAME.tex and NAME.md of each table into a folder of an output."""
    writers = {"csv": as_csv, "tex": as_latex, "md": as_markdown}
    texts = {
        f"{folder.name}/{file_name(name)}.{suffix}": writers[suffix](table)
        for name, table in tables.items()
        for suffix in FORMATS
    }
    with files_together(folder.parent, texts) as staged:
        for name, text in texts.items():
            (staged / name).write_text(text, encoding="utf-8")
    return [folder.parent / name for name in texts]


def file_name(name: str) -> str:
    """A name as a file's: letters, digits, dots and dashes, never hidden and never a folder."""
    return re.sub(r"[^\w.-]+", "-", name).lstrip(".-") or "table"


def as_csv(table: Grid) -> str:
    """Nine digits or more, in the unit of the heading; undefined numbers are empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_headings(table))
    for line in table.lines:
        writer.writerow(map(_plain, line, table.heads))
    return stream.getvalue()


def _plain(cell: GridCell, head: Head) -> float | str:
    if head.text:
        return cell.text
    return in_unit(cell.value, head.unit) if math.isfinite(cell.value) else ""


def as_markdown(table: Grid) -> str:
    """A table as GitHub and most other renderers read it."""
    rule = ["---", *("--:" for _ in table.heads[1:])]
    lines = [[_cell(cell, _md, "**{}**") for cell in line] for line in table.lines]
    rows = [[_md(text) for text in _headings(table)], rule, *lines]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def as_latex(table: Grid) -> str:
    """A `table` environment that needs the package booktabs and nothing else."""
    body = [
        " & ".join(_cell(cell, _tex, r"\textbf{{{}}}") for cell in line) + r" \\"
        for line in table.lines
    ]
    parts = [
        r"\begin{table}", r"\centering", rf"\caption{{{_tex(table.about)}}}",
        rf"\begin{{tabular}}{{l{'r' * (len(table.heads) - 1)}}}", r"\toprule",
        " & ".join(map(_tex, _headings(table))) + r" \\", r"\midrule",
        *body, r"\bottomrule", r"\end{tabular}", r"\end{table}",
    ]  # fmt: skip
    return "\n".join(parts) + "\n"


def _cell(cell: GridCell, escape: Callable[[str], str], bold: str) -> str:
    text = escape(cell.text)
    return bold.format(text) if cell.kind == "best" else text


def _md(text: str) -> str:
    flat = " ".join(text.split("\n"))
    escaped = re.sub(r"([\\`*_|\[\]])", r"\\\1", flat)
    return escaped.replace("<", "&lt;")


def _tex(text: str) -> str:
    return "".join(_TEX.get(letter, letter) for letter in " ".join(text.split("\n")))


def report_tables(data: RunData) -> dict[str, Grid]:
    """The page's rankings, by name; none where nothing was scored."""
    metric = data.ranking_metric
    by = f"ordered by {column(metric).title}"
    rows = {case.name: data.rows_of(case.name, POOLED) for case in data.cases}
    scored = {case: of_case for case, of_case in rows.items() if len(of_case)}
    tables = {
        case: ranking_table(table(of_case, metric), f"{case}, {by}.")
        for case, of_case in scored.items()
    }
    if len(scored) > 1:
        means = mean_over_cases(together(scored.values()), "mean")
        caption = f"Mean of {len(scored)} cases, {by}."
        tables["ranking-mean"] = ranking_table(table(means, metric), caption)
    return tables


def write_report_figures(run_dir: Path, suffix: FigureFormat) -> list[Path]:
    """Writes every case's curves, causes and slices as files."""
    data = load_run(run_dir)
    with mpl.rc_context(_FILE_STYLE):
        figures = {
            f"{FIGURES_FOLDER}/{file_name(f'{case.name}-{name}')}.{suffix}": figure
            for case in data.cases
            for name, figure in _figures(data, case)
        }
        with files_together(run_dir, figures) as staged:
            for name, figure in figures.items():
                figure.savefig(staged / name, format=suffix, metadata=_UNDATED[suffix])
    return [run_dir / name for name in figures]


def _figures(data: RunData, case: CaseData) -> Iterator[tuple[str, Figure]]:
    rows = data.rows_of(case.name, POOLED)
    methods = with_predictions([m.name for window in case.windows for m in window.methods], rows)
    if curves := curves_of(rows, methods):
        yield "curves", curves_figure(curves, case.name)
    if causes := outlier_causes(rows, methods):
        yield "causes", causes_figure(causes)
    for window in case.windows:
        for method in window.methods:
            if method.dsi_slice is not None:
                yield f"{window.name}-slice-{method.name}", slice_figure(method.dsi_slice)
