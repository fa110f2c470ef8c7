"""`eventsweep score`: maps against ground truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from eventsweep.eval.cli.app import CONFIGURED, SCORE, Configured, Predictions, ScoreFlags, app

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

    from eventsweep.eval.cli.console import Console, Part
    from eventsweep.eval.scoring.results import Results

# As many as fit 80 characters; the report has them all.
_COLUMNS = ("points", "mean_error", "common_mean_error", "median_error", "abs_rel", "bad_published")
_ARROWS = {"lower": "↓", "higher": "↑", "none": ""}


@app.command
def score(
    folder: Path,
    /,
    *,
    prediction: Predictions = (),
    common: Configured = CONFIGURED,
    score: ScoreFlags = SCORE,
) -> None:
    """Score the maps of a run or of one mapped sequence against ground truth.

    Args:
        folder: What `run` or `map` wrote; results.json and results.csv in it are written anew.
        prediction: NAME=DIR or DIR with depth maps of another method, scored too; repeatable.
    """
    from eventsweep.eval.pipeline import score_folder

    wanted = common.settings(score=score)
    console = common.console()
    results = score_folder(folder, wanted.score, prediction)
    show_results(console, results, wanted.score.ranking_metric)
    console.wrote(folder / "results.json")


def show_results(console: Console, results: Results, metric: str) -> None:
    """Prints the ranking of each case by a metric, and what it says in words."""
    from eventsweep.eval.scoring.results import to_json

    console.result(to_json(results), _rankings(results, metric))


def _rankings(results: Results, metric: str) -> Iterator[Part]:
    from eventsweep.eval.cli.console import dim
    from eventsweep.eval.report import ranking
    from eventsweep.eval.scoring.results import POOLED

    pooled = results.rows[results.rows["window"] == POOLED]
    for case in pooled["case"].unique():
        rows = pooled[pooled["case"] == case]
        yield _ranking(case, rows, metric)
        yield from map(dim, ranking.findings(rows, metric))
        counts = results.configuration.get(case, {}).get("windows")
        if counts is not None:
            lacking, scored = counts["without_truth"], counts["scored"]
            yield (
                f"{scored} of {scored + lacking} windows scored: {lacking} have no ground truth "
                "at their reference time."
            )


def _ranking(case: str, rows: pd.DataFrame, metric: str) -> Table:
    from rich.text import Text

    from eventsweep.eval.cli.console import table
    from eventsweep.eval.report import ranking

    content = ranking.table(rows, metric, _COLUMNS)
    headings = [
        f">{column.title} {_ARROWS[column.direction]}\n{column.unit}" for column in content.columns
    ]
    lines: list[list[str | Text]] = [
        [line.method, *(Text(cell.text, "bold" if cell.kind else "") for cell in line.cells)]
        for line in content.lines
    ]
    title = f"{case}, by {ranking.column(metric).title}"
    return table(title, ("method", *headings), lines)
