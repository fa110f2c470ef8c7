"""`eventsweep score`: maps against ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from eval.cli.app import CONFIGURED, NO_NEGATIVE, SCORE, Configured, ScoreFlags, app


@app.command
def score(
    folder: Path,
    /,
    *,
    prediction: Annotated[tuple[Path, ...], NO_NEGATIVE] = (),
    common: Configured = CONFIGURED,
    score: ScoreFlags = SCORE,
) -> None:
    """Score the maps of a run or of one mapped sequence against ground truth.

    Args:
        folder: What `run` or `map` wrote; results.json and results.csv in it are written anew.
        prediction: Folder with depth maps of another method, scored beside ours, repeatable.
    """
    from eval.pipeline import score_folder

    wanted = common.settings(score=score)
    console = common.console()
    results = score_folder(folder, wanted.score, prediction)
    console.results(results, wanted.score.ranking_metric)
    console.wrote(folder / "results.json")
