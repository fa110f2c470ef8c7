"""The page of a suite's run: the mean over its cases, and every case, over all seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from pathlib import Path
from typing import get_args

from eventsweep.emvs.utils.inputs import inside
from eventsweep.emvs.utils.outputs import check_files
from eventsweep.eval.config import EvalConfig, RankingMetric
from eventsweep.eval.figures.colormaps import line_style
from eventsweep.eval.figures.images import data_uri
from eventsweep.eval.numbers import displayed
from eventsweep.eval.report.html import (
    REPORT_NAME,
    Grid,
    GridCell,
    Head,
    Page,
    Picture,
    Section,
    files_in,
    page_text,
    plural,
    versions_grid,
    write_page,
)
from eventsweep.eval.report.ranking import (
    RANKING_COLUMNS,
    RankingLine,
    RankingTable,
    best_words,
    column,
    findings,
    mean_over_cases,
    table,
)
from eventsweep.eval.results.results import (
    PICTURES_FOLDER,
    SUITE_CSV,
    SUITE_NAME,
    Results,
    read_results,
)
from eventsweep.eval.results.series import Series, means_over_seeds, measured_of

_ABOUT = (
    "Of each case: means over the seeds ± their standard deviation, where there is more than one; "
    "the best of each column is marked. Single cameras have no rank: they are the baseline of all "
    "others."
)
_OVER_CASES = (
    "Every case weighs the same, and pixels are the mean of a case. A method that lacks one of "
    "the cases has no mean."
)


def is_suite_folder(folder: Path) -> bool:
    """Whether a suite's run lies in a folder."""
    return (folder / SUITE_NAME).is_file()


def write_suite_report(folder: Path) -> Path:
    """Writes `report.html` for the suite's run in a folder and returns its path."""
    check_files(folder, (REPORT_NAME,), force=True)
    return write_page(folder, read_results(folder, lambda result: _page_text(folder, result)))


def _page_text(folder: Path, result: Results) -> str:
    pictures = {case: inside(folder, f"{PICTURES_FOLDER}/{case}.png") for case in result.cases}
    shown = {
        case: data_uri("image/png", path.read_bytes())
        for case, path in pictures.items()
        if path.is_file()
    }
    return page_text(suite_page(result, files_in(folder, (SUITE_NAME, SUITE_CSV)), shown))


def suite_page(result: Results, files: Sequence[str], pictures: Mapping[str, str]) -> Page:
    """What the page shows; `pictures` are addresses that hold one, by case."""
    series = measured_of(result).series
    metric = _ordering_metric(result, {numbers.metric for numbers in series.values()})
    shown = [numbers for numbers in series.values() if numbers.metric in RANKING_COLUMNS]
    by_case = {
        case: [numbers for numbers in shown if numbers.case == case] for case in result.cases
    }
    measured = {case: found for case, found in by_case.items() if found}
    lead, first = _lead(measured, metric), next(iter(pictures), "")
    return Page(
        title=f"{result.suite}, {result.subset}",
        subtitle=f"A suite's run: {plural(len(measured), 'case')}, "
        f"{plural(len(result.seeds), 'seed')} ({', '.join(map(str, result.seeds))}).",
        lead=lead,
        pictures=(Picture(first, pictures[first], "camera, depth, true depth"),) if first else (),
        sections=tuple(
            replace(
                _section(k, case, found, metric),
                figure="" if case == first else pictures.get(case, ""),
            )
            for k, (case, found) in enumerate(measured.items())
        ),
        provenance=_provenance(result),
        overview=_overview(measured, metric),
        findings=tuple(f"failed: {job.name}: {job.failure}" for job in result.failures),
        note=_ABOUT,
        version=result.versions.get("eventsweep", ""),
        files=tuple(files),
    )


def _lead(by_case: Mapping[str, Sequence[Series]], metric: str) -> str:
    """Who is ahead over all cases."""
    rows = means_over_seeds([one for found in by_case.values() for one in found])
    return best_words(mean_over_cases(rows, "mean"), metric) if by_case else ""


def _provenance(result: Results) -> Grid:
    grid = versions_grid([result.platform or "here"], [result.versions])
    given = [(GridCell(name), GridCell(digest)) for name, digest in result.predictions.items()]
    return replace(grid, lines=(*grid.lines, *given))


def _ordering_metric(result: Results, measured: Set[str]) -> str:
    """The suite's ranking metric, or the first that it measures: it need not measure all."""
    chosen = EvalConfig.model_validate(result.definition.get("score", {})).ranking_metric
    others = (*get_args(RankingMetric), *RANKING_COLUMNS)
    return next((name for name in (chosen, *others) if name in measured), chosen)


def _overview(by_case: Mapping[str, Sequence[Series]], metric: str) -> Grid | None:
    """The mean over cases; None of fewer than two, which would repeat the case."""
    if len(by_case) < 2:
        return None
    rows = means_over_seeds([one for found in by_case.values() for one in found])
    about = f"Mean of {len(by_case)} cases, by {column(metric).title}. {_OVER_CASES}"
    return _grid(table(mean_over_cases(rows, "mean"), metric), {}, about)


def _section(position: int, case: str, found: Sequence[Series], metric: str) -> Section:
    rows = means_over_seeds(found)
    about = f"By {column(metric).title}."
    spreads = {(one.method, one.metric): displayed(one.spread, one.unit) for one in found}
    return Section(
        id=f"case{position}",
        title=case,
        names=("ranking",),
        tables=(_grid(table(rows, metric), spreads, about),),
        text=" ".join(findings(rows, metric)[:1]),
        figure_about="what the camera saw, depth maps and true depth",
    )


def _grid(ranking: RankingTable, spreads: Mapping[tuple[str, str], str], about: str) -> Grid:
    heads = (Head("method", text=True), Head("rank"), *ranking.heads())
    return Grid(heads, tuple(_line(line, ranking, spreads) for line in ranking.lines), about)


def _line(
    line: RankingLine, ranking: RankingTable, spreads: Mapping[tuple[str, str], str]
) -> tuple[GridCell, ...]:
    rank = GridCell("" if line.rank is None else str(line.rank), line.rank or math.nan)
    cells = [GridCell(line.method, colour=line_style(line.method).css), rank]
    for head, cell in zip(ranking.columns, line.cells, strict=True):
        spread = spreads.get((line.method, head.name), "–")
        text = cell.text if spread == "–" else f"{cell.text} ± {spread}"
        cells.append(replace(cell, text=text))
    return tuple(cells)
