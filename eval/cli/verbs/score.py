"""`eventsweep score`: maps against ground truth, trajectories against true poses.

A plug-in scores files of other kinds; its module, which is light, is a `Scorer`:

    [project.entry-points."eventsweep.scorers"]
    mine = "my_package.scorer"
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

from cyclopts import Group, Parameter
from pydantic import create_model

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.parameters import ParameterGroup
from eventsweep.emvs.utils.plugins import SCORERS, loaded, points
from eventsweep.eval.cli.app import (
    CONFIGURED,
    NO_NEGATIVE,
    SCORE,
    TRAJECTORY,
    Configured,
    Force,
    Predictions,
    ScoreFlags,
    TrajectoryFlags,
    app,
    command_line,
)
from eventsweep.eval.cli.flag_names import with_flags
from eventsweep.eval.cli.help import RARE
from eventsweep.eval.config import EvalConfig, TrajectoryConfig

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

    from eventsweep.eval.cli.console import Console, Part
    from eventsweep.eval.report.trajectory_page import WrittenScores
    from eventsweep.eval.results.results import Results

# As many as fit 80 characters; the report has them all.
_COLUMNS = ("points", "mean_error", "common_mean_error", "median_error", "abs_rel", "bad_published")
_ARROWS = {"lower": "↓", "higher": "↑", "none": ""}
_CANNOT = "its scores {} cannot be used"


class Scorer(Protocol):
    """What scores files of a kind against a sequence; `Config` has fields that become flags."""

    Config: type[ParameterGroup]

    def takes(self, scored: str) -> bool:
        """Whether `FILE` or `NAME=FILE` is of its kind, by the name alone."""

    def check(self, scored: str) -> None:
        """Refuses a file that cannot be scored, as far as no truth is needed."""

    def score(
        self, scored: tuple[str, ...], truth: Path, out: Path | None, console: Console, *,
        config: Any, align: str | None, case: str | None, force: bool, command: str,
    ) -> None:  # fmt: skip
        """Prints scores, and writes a folder if asked; `align` is None where nobody set it."""


def _flags() -> Any:
    """The flags of all scorers; one that cannot be loaded says so where a file is scored."""
    groups: list[type[ParameterGroup]] = []
    for point in points(SCORERS):
        with suppress(InputError):
            groups.append(loaded(point, _CANNOT).Config)
    return create_model("Further", __base__=(*groups, ParameterGroup))


_Further = _flags()
_FURTHER = _Further()
if TYPE_CHECKING:
    FurtherFlags = ParameterGroup
else:  # what plug-ins bring is known when the program starts
    _GROUP = Group.create_ordered("Geometries")
    _ANY = bool(_Further.model_fields)
    _TAKEN = Parameter(name="*", group=_GROUP, parse=_ANY, show=_ANY)
    FurtherFlags = Annotated[_Further, _TAKEN, RARE]


@app.command
def score(
    scored: Annotated[tuple[str, ...], NO_NEGATIVE],
    /,
    *,
    truth: Path | None = None,
    out: Path | None = None,
    case: str | None = None,
    prediction: Predictions = (),
    force: Force = False,
    trajectory: TrajectoryFlags = TRAJECTORY,
    common: Configured = CONFIGURED,
    score: ScoreFlags = SCORE,
    further: FurtherFlags = _FURTHER,
) -> None:
    """Score maps against ground truth; with --truth trajectories, clouds, meshes or splats.

    Args:
        scored: Folder that `run` or `map` wrote; its results.json and results.csv are replaced.
            With --truth: poses in TUM format or geometries, one or more, as FILE or NAME=FILE; of
            poses also a FOLDER.
        truth: True poses of the same body, a TUM file or a recording's folder; of a geometry a
            sequence.
        out: Folder to write with --truth: results.json, results.csv, report.html.
        case: Name of the recording in the results; by default the truth's.
        prediction: NAME=DIR or DIR with depth maps of another method, or rendered from splats,
            scored too; repeatable.
    """
    if truth is not None:
        _refuse(
            ("--prediction", bool(prediction)),
            ("--score.", score != SCORE),
            of="maps: leave out --truth",
        )
        scorer = scorer_of(scored)
        if scorer is not None:
            _score_by(scorer, scored, truth, out, case, trajectory, further, common, force=force)
            return
        _refuse(("the flags of geometries", further != _FURTHER), of="geometries: name one")
        _score_trajectories(scored, truth, out, case, trajectory, common, force=force)
        return
    _refuse(("the flags of geometries", further != _FURTHER), of="geometries: add --truth")
    _refuse(
        ("--out", out is not None), ("--case", case is not None), ("--force", force),
        ("the flags of trajectories", trajectory != TRAJECTORY), of="trajectories: add --truth",
    )  # fmt: skip
    if len(scored) != 1:
        raise InputError(f"{len(scored)} folders of maps: name one; trajectories need --truth")
    _score_maps(Path(scored[0]), prediction, common, score)


def _refuse(*flags: tuple[str, bool], of: str) -> None:
    for name, is_given in flags:
        if is_given:
            is_ = "are" if name.startswith("the ") else "is"
            raise InputError(f"{name} {is_} for {of}, or leave out {name}")


def scorer_of(scored: tuple[str, ...]) -> Scorer | None:
    """The plug-in that one of the files is for."""
    for point in points(SCORERS):
        scorer: Scorer = loaded(point, _CANNOT)
        if any(map(scorer.takes, scored)):
            return scorer
    return None


def _score_by(
    scorer: Scorer, scored: tuple[str, ...], truth: Path, out: Path | None, case: str | None,
    trajectory: TrajectoryConfig, further: ParameterGroup, common: Configured, *, force: bool,
) -> None:  # fmt: skip
    given = trajectory.model_fields_set
    others = [(f"--{name.replace('_', '-')}", True) for name in given - {"align"}]
    _refuse(*others, of="trajectories: leave the geometries out")
    own = further.model_dump(include={*scorer.Config.model_fields}, exclude_unset=True)
    common.settings()
    scorer.score(
        scored, truth, out, common.console(), config=scorer.Config(**own), case=case, force=force,
        align=trajectory.align if "align" in given else None, command=command_line(),
    )  # fmt: skip


def _score_maps(
    folder: Path, prediction: tuple[str, ...], common: Configured, score: EvalConfig
) -> None:
    from eventsweep.eval.pipeline import score_folder

    wanted = common.settings(score=score)
    console = common.console()
    results = score_folder(folder, wanted.score, prediction)
    show_results(console, results, wanted.score.ranking_metric)
    console.wrote(folder / "results.json")


def _score_trajectories(
    estimates: tuple[str, ...], truth: Path, out: Path | None, case: str | None,
    config: TrajectoryConfig, common: Configured, *, force: bool,
) -> None:  # fmt: skip
    from eventsweep.eval.report.trajectory_page import write_scores
    from eventsweep.eval.results.results import to_json

    if out is None:
        raise InputError("scores of trajectories need a folder: add --out")
    common.settings()
    console = common.console()
    written = write_scores(
        estimates, truth, out, config, case=case, force=force, command=command_line()
    )
    console.result(to_json(written.results), _trajectories(written))
    for note in written.notes:
        console.warn(with_flags(note))
    console.wrote(out / "report.html")


def _trajectories(written: WrittenScores) -> Iterator[Part]:
    from eventsweep.eval.cli.console import table
    from eventsweep.eval.report.trajectory_page import overview_grid

    grid = overview_grid(written.scored)
    headings = (f">{head.title} {_ARROWS[head.direction]}\n{head.unit}" for head in grid.heads[1:])
    lines = ([cell.text for cell in line] for line in grid.lines)
    yield table(f"{written.case}: {written.how}", ("estimate", *headings), lines)


def show_results(console: Console, results: Results, metric: str) -> None:
    """Prints the ranking of each case by a metric, and what it says in words."""
    from eventsweep.eval.results.results import to_json

    console.result(to_json(results), _rankings(results, metric))


def _rankings(results: Results, metric: str) -> Iterator[Part]:
    from eventsweep.eval.cli.console import dim
    from eventsweep.eval.report import ranking
    from eventsweep.eval.results.table import POOLED

    pooled = results.rows[results.rows["window"] == POOLED]
    for case in pooled["case"].unique():
        rows = pooled[pooled["case"] == case]
        if "reported" in set(rows["metric"]):
            yield _without_truth(case, rows)
            continue
        yield _ranking(case, rows, metric)
        yield from map(dim, ranking.findings(rows, metric))
        counts = results.configuration.get(case, {}).get("windows")
        if counts is not None:
            lacking, scored = counts["without_truth"], counts["scored"]
            yield (
                f"{scored} of {scored + lacking} windows scored: {lacking} have no ground truth "
                "at their reference time."
            )


def _without_truth(case: str, rows: pd.DataFrame) -> Table:
    from eventsweep.eval.cli.console import table
    from eventsweep.eval.numbers import displayed
    from eventsweep.eval.results.table import EVENTS

    of_methods = rows[rows["method"] != EVENTS].pivot(
        index="method", columns="metric", values="value"
    )
    lines = (
        (str(method), f"{depths['reported']:,.0f}", displayed(depths["median_depth"], "m"))
        for method, depths in of_methods.iterrows()
    )
    title = f"{case}: no ground truth, so no errors"
    return table(title, ("method", ">points\nreported", ">median depth\ncm"), lines)


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
