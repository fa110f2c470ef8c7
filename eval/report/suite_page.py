"""The page of a suite's run: the mean over its cases, and every case, over all seeds."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import get_args

from eventsweep.emvs.utils.inputs import inside
from eventsweep.emvs.utils.outputs import check_files
from eventsweep.eval.config import EvalConfig, RankingMetric
from eventsweep.eval.figures.images import data_uri
from eventsweep.eval.jobs.job import NOT_YET
from eventsweep.eval.numbers import displayed
from eventsweep.eval.report.html import (
    REPORT_NAME,
    Block,
    Page,
    Plot,
    Section,
    Sentences,
    Text,
    files_in,
    grid,
    page_text,
    plural,
    provenance,
    versions_grid,
    write_page,
)
from eventsweep.eval.report.ranking import (
    RANKING_COLUMNS,
    column,
    mean_over_cases,
    standings_of,
    table,
)
from eventsweep.eval.report.run_page import columns_by, lead
from eventsweep.eval.results.results import (
    PICTURES_FOLDER,
    SUITE_CSV,
    SUITE_NAME,
    Results,
    read_results,
)
from eventsweep.eval.results.series import Series, means_over_seeds, measured_of
from eventsweep.eval.results.table import POOLED
from eventsweep.eval.scoring.standings import RULE, Standing

_ABOUT = (
    "Of each case: means over the seeds ± their standard deviation, where there is more than one; "
    "the best of each column is marked."
)
_PICTURE = "what the camera saw, depth maps and true depth"
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
    series = list(measured_of(result).series.values())
    metric = _ordering_metric(result, {numbers.metric for numbers in series})
    shown = [numbers for numbers in series if numbers.metric in RANKING_COLUMNS]
    by_case = {case: [n for n in shown if n.case == case] for case in result.cases}
    measured = {case: numbers for case, numbers in by_case.items() if numbers}
    first = next(iter(pictures), "")
    return Page(
        title=f"{result.suite}, {result.subset}",
        subtitle=f"A suite's run: {plural(len(measured), 'case')}, "
        f"{plural(len(result.seeds), 'seed')} ({', '.join(map(str, result.seeds))}).",
        blocks=tuple(_verdict(result, measured, metric, first, pictures)),
        sections=(
            *(
                _section(
                    result, k, numbers, metric, "" if case == first else pictures.get(case, "")
                )
                for k, (case, numbers) in enumerate(measured.items())
            ),
            _provenance(result),
        ),
        version=result.versions.get("eventsweep", ""),
        files=tuple(files),
    )


def _verdict(
    result: Results, by_case: Mapping[str, Sequence[Series]], metric: str, first: str,
    pictures: Mapping[str, str],
) -> Iterator[Block]:  # fmt: skip
    """Who is ahead over all cases, the first case's picture, and the mean over the cases."""
    rows = means_over_seeds([numbers for of_case in by_case.values() for numbers in of_case])
    mean = mean_over_cases(rows, "mean") if by_case else rows
    if ranks := _standings(result, metric, by_case):
        yield Text(lead(ranks, rows, metric, len(result.seeds)), "lead")
    if first:
        yield Plot(pictures[first], f"{first}: {_PICTURE}")
    yield Sentences(tuple(_missing(result)))
    if len(by_case) > 1:  # the mean of a single case would repeat it
        about = f"Mean of {len(by_case)} cases, by {column(metric).title}. {_OVER_CASES}"
        yield table(mean, metric, columns_by(metric), ranks).grid(about)
    yield Text(f"{RULE.format(title=column(metric).title)} {_ABOUT}", "note")


def _missing(result: Results) -> Iterator[str]:
    failed = [job for job in result.failures if not job.failure.endswith(NOT_YET)]
    if not_yet := len(result.failures) - len(failed):
        yield f"{not_yet} of {len(result.jobs)} jobs are {NOT_YET}: this is of the others."
    yield from (f"failed: {job.name}: {job.failure}" for job in failed)


def _standings(result: Results, metric: str, cases: Collection[str]) -> tuple[Standing, ...]:
    rows = result.rows
    return standings_of(rows[(rows["window"] == POOLED) & rows["case"].isin(cases)], metric)


def _provenance(result: Results) -> Section:
    made = versions_grid([result.platform or "here"], [result.versions])
    return provenance(grid(made.heads, (*made.lines, *result.predictions.items())))


def _ordering_metric(result: Results, measured: Set[str]) -> str:
    """The suite's ranking metric, or the first that it measures: it need not measure all."""
    chosen = EvalConfig.model_validate(result.definition.get("score", {})).ranking_metric
    known = (chosen, *get_args(RankingMetric), *RANKING_COLUMNS)
    return next((name for name in known if name in measured), chosen)


def _section(
    result: Results, position: int, series: Sequence[Series], metric: str, picture: str
) -> Section:
    case = series[0].case
    rows = means_over_seeds(series)
    ranks = _standings(result, metric, (case,))
    spreads = {(n.method, n.metric): displayed(n.spread, n.unit) for n in series}
    blocks: tuple[Block, ...] = (
        *((Text(lead(ranks, rows, metric, len(result.seeds))),) if ranks else ()),
        *((Plot(picture, f"{case}: {_PICTURE}"),) if picture else ()),
        table(rows, metric, columns_by(metric), ranks).grid(f"By {column(metric).title}.", spreads),
    )
    return Section(f"case{position}", case, blocks)
