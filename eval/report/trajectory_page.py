"""The page of scored trajectories: numbers side by side, the path, errors over time and way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from eventsweep.emvs.errors import significant
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.outputs import atomic_dir, check_output
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.config import TrajectoryConfig
from eventsweep.eval.figures.colormaps import line_style
from eventsweep.eval.figures.plots import svg
from eventsweep.eval.figures.trajectories import (
    Scored,
    boxes_figure,
    errors_figure,
    path_figure,
)
from eventsweep.eval.report.html import (
    REPORT_NAME,
    Grid,
    GridCell,
    Head,
    command_grid,
    files_in,
    render,
    versions_grid,
)
from eventsweep.eval.report.ranking import column, value_cell
from eventsweep.eval.results.direction import best
from eventsweep.eval.results.results import Results, write_results
from eventsweep.eval.scoring.trajectories.score import TrajectoryScore, results_of
from eventsweep.eval.scoring.trajectories.sources import (
    read_estimate,
    read_truth,
    score_sources,
)

COLUMNS = (
    "ate_rmse", "ate_share", "ate_rotation_rmse", "drift", "scale_error", "time_covered",
)  # fmt: skip
"""What the first table shows, and the terminal; the page's second table has everything."""
_RULES = {
    "one-to-one": "poses are paired one to one, the closest in time first, at most {s:g} s apart",
    "nearest": "each pose of the shorter trajectory is paired with the nearest of the longer one, "
    "at most {s:g} s apart",
    "interpolate": "the truth is interpolated at the time of every estimated pose",
}
_ALIGNMENTS = {
    "se3": "aligned with the truth by a rigid motion, SE(3)",
    "sim3": "aligned with the truth by a rigid motion and a scale, Sim(3)",
    "none": "not aligned",
}


@dataclass(frozen=True)
class WrittenScores:
    """Scores of a case that were written into a folder: by estimate, and as a table."""

    case: str
    scored: Scored
    results: Results

    @property
    def how(self) -> str:
        """Alignment and association in a sentence."""
        return how(next(iter(self.scored.values())))

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the numbers must know."""
        return tuple(notes(self.scored))


def write_scores(
    estimates: Sequence[str | Path], truth: Path, out: Path, config: TrajectoryConfig, *,
    case: str | None = None, force: bool = False, command: str = "",
) -> WrittenScores:  # fmt: skip
    """Scores trajectories and writes `results.json`, `results.csv` and `report.html`.

    Args:
        estimates: `FILE`, `FOLDER` or `NAME=FILE`, as `read_estimate` takes them.
        truth: a file of poses, or a recording's folder.
        out: folder to write.
        config: how.
        case: what the results call the recording; by default as the truth is called.
        force: whether an output of ours in its place is replaced.
        command: what the page says that made it.

    Raises:
        InputError: what the readers and `score_poses` refuse, or an output that is in the way.
    """
    true = read_truth(truth, config)
    sources = [read_estimate(one, config) for one in estimates]
    inputs = (truth, *(one.path for one in sources))
    check_output(out, force=force)
    scored, name = score_sources(sources, true, config), case or true.name
    files = {one.name: one.path.name for one in sources}
    results = results_of(name, scored, {"truth": truth.name, "estimates": files})
    with atomic_dir(out, force=force, inputs=inputs) as folder:
        write_results(folder, results)
        text = page_text(name, true.trajectory, scored, command, folder)
        (folder / REPORT_NAME).write_text(text, encoding="utf-8")
    return WrittenScores(name, scored, results)


def page_text(case: str, truth: Trajectory, scored: Scored, command: str, folder: Path) -> str:
    """The page as HTML."""
    libraries = versions()
    return render(
        "trajectory.html.j2", "tables", "sides",
        title=f"Trajectories of {case}", subtitle=how(next(iter(scored.values()))),
        sentences=list(sentences(scored)), notes=list(notes(scored)),
        overview=overview_grid(scored), everything=metrics_grid(scored),
        path=Markup(svg(path_figure, truth, scored)),
        errors=Markup(svg(errors_figure, truth, scored)),
        boxes=Markup(svg(boxes_figure, scored)),
        provenance=command_grid(command),
        versions=versions_grid(["this page"], [libraries]), version=libraries["eventsweep"],
        files=files_in(folder, ("results.json", "results.csv")),
    )  # fmt: skip


def how(found: TrajectoryScore) -> str:
    """Alignment and association in a sentence: numbers say nothing without them."""
    config = found.config
    rule = _RULES[config.associate].format(s=config.max_difference_s)
    offset = f"; {config.offset_s:g} s are added to the estimate's times" * bool(config.offset_s)
    return f"Estimates are {_ALIGNMENTS[config.align]}; {rule}{offset}."


def sentences(scored: Scored) -> Iterator[str]:
    """What the page says first, one line for each estimate."""
    for method, found in scored.items():
        values = found.values
        yield (
            f"{method}: ATE {significant(100 * values['ate_rmse'], 3)} cm, "
            f"{significant(values['ate_share'], 3)} % of a path of "
            f"{significant(values['way'], 3)} m; drift {significant(values['drift'], 3)} %; "
            f"{values['time_covered']:.1f} % of the time covered, {len(found.matched):,} poses."
        )


def notes(scored: Scored) -> Iterator[str]:
    """What a reader of the numbers must know."""
    for method, found in scored.items():
        yield from (f"{method}: {note}." for note in found.notes)


def overview_grid(scored: Scored) -> Grid:
    """A line for each estimate: what decides, the best marked."""
    heads = [column(name) for name in COLUMNS]
    cells = {name: _cells(scored, name) for name in COLUMNS}
    lines = tuple(
        (GridCell(method, colour=line_style(method).css), *(cells[name][k] for name in COLUMNS))
        for k, method in enumerate(scored)
    )
    return Grid((Head("estimate"), *(one.head(one.title) for one in heads)), lines)


def metrics_grid(scored: Scored) -> Grid:
    """A line for each metric, with what it is."""
    heads = [column(score.metric) for score in next(iter(scored.values())).scores]
    lines = (
        (GridCell(one.title), GridCell(one.unit), *_cells(scored, one.name), GridCell(one.formula))
        for one in heads
    )
    names = (Head("metric", text=True), Head("unit", text=True), *map(Head, scored))
    return Grid((*names, Head("what it is", text=True)), tuple(lines))


def _cells(scored: Scored, name: str) -> list[GridCell]:
    rows = [next(row for row in found.scores if row.metric == name) for found in scored.values()]
    top = best((row.value for row in rows), rows[0].direction) if len(rows) > 1 else math.nan
    return [value_cell(row.value, row.unit, top) for row in rows]
