"""`eventsweep score`: maps against ground truth."""

from __future__ import annotations

from pathlib import Path

from eventsweep.eval.cli.app import CONFIGURED, SCORE, Configured, Predictions, ScoreFlags, app


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
    console.results(results, wanted.score.ranking_metric)
    console.wrote(folder / "results.json")
