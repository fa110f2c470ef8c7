"""What `eventsweep report` leaves beside the page on request: tables and figures as files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import matplotlib as mpl
from matplotlib.figure import Figure

from emvs.utils.files import atomic_path
from eval.figures.plots import STYLE, causes_figure, curves_figure, outlier_causes, slice_figure
from eval.panels import curves_of, with_given
from eval.ranking import column, mean_over_cases, table
from eval.report_load import load_run
from eval.scoring.score import POOLED
from eval.tables import TextTable, file_name, ranking_table, write_tables
from eval.views import CaseView, ReportData

FigureFormat = Literal["svg", "pdf"]
TABLES_FOLDER, FIGURES_FOLDER = "tables", "figures"
# A file has no text around it to take its colour from; without dates, equal data give equal bytes.
_FILE_STYLE = {**STYLE, "savefig.facecolor": "white", "pdf.fonttype": 42}


def write_report_tables(run_dir: Path) -> list[Path]:
    """Writes the ranking of all cases, and of each, as CSV, LaTeX and Markdown.

    Raises:
        InputError: no maps, or a damaged file.
    """
    return write_tables(run_dir / TABLES_FOLDER, report_tables(load_run(run_dir)))


def report_tables(data: ReportData) -> dict[str, TextTable]:
    """The page's rankings, by name; none where nothing was scored."""
    metric = data.ranking_metric
    by = f"ordered by {column(metric).title}"
    rows = {case.name: data.rows_of(case.name, POOLED) for case in data.cases}
    scored = {case: found for case, found in rows.items() if found}
    tables = {
        case: ranking_table(table(found, metric), f"{case}, {by}.")
        for case, found in scored.items()
    }
    if len(scored) > 1:
        means = mean_over_cases([row for found in scored.values() for row in found], "mean")
        caption = f"Mean of {len(scored)} cases, {by}."
        tables["ranking-mean"] = ranking_table(table(means, metric), caption)
    return tables


def write_report_figures(run_dir: Path, suffix: FigureFormat) -> list[Path]:
    """Writes every case's curves, causes and slices as files.

    Raises:
        InputError: no maps, or a damaged file.
    """
    data, paths = load_run(run_dir), []
    with mpl.rc_context(_FILE_STYLE):
        for case in data.cases:
            for name, figure in _figures(data, case):
                path = run_dir / FIGURES_FOLDER / f"{file_name(f'{case.name}-{name}')}.{suffix}"
                _save(figure, path, suffix)
                paths.append(path)
    return paths


def _figures(data: ReportData, case: CaseView) -> Iterator[tuple[str, Figure]]:
    rows = data.rows_of(case.name, POOLED)
    methods = with_given([m.name for window in case.windows for m in window.methods], rows)
    if curves := curves_of(rows, methods):
        yield "curves", curves_figure(curves, case.name)
    if causes := outlier_causes(rows, methods):
        yield "causes", causes_figure(causes)
    for window in case.windows:
        for method in window.methods:
            if method.piece is not None:
                yield f"{window.name}-slice-{method.name}", slice_figure(method.piece)


def _save(figure: Figure, path: Path, suffix: FigureFormat) -> None:
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}[suffix]
    with atomic_path(path) as partial, partial.open("wb") as stream:
        figure.savefig(stream, format=suffix, metadata=undated)
