"""The page of scored trajectories: numbers side by side, the path, errors over time and way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from eventsweep.emvs.errors import significant
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.outputs import atomic_dir, check_output
from eventsweep.eval.config import TrajectoryConfig
from eventsweep.eval.figures.plots import svg
from eventsweep.eval.figures.trajectories import Scored, boxes_figure, errors_figure, path_figure
from eventsweep.eval.report.html import (
    REPORT_NAME,
    Grid,
    GridCell,
    Head,
    Page,
    Plot,
    Section,
    Sentences,
    Text,
    files_in,
    grid,
    made_here,
    page_text,
)
from eventsweep.eval.report.ranking import column, named_cell, value_cell
from eventsweep.eval.results.direction import best
from eventsweep.eval.results.results import Results, write_results
from eventsweep.eval.scoring.trajectories.score import TrajectoryScore, results_of
from eventsweep.eval.scoring.trajectories.sources import read_estimate, read_truth, score_sources

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
    sources = [read_estimate(estimate, config) for estimate in estimates]
    inputs = (truth, *(source.path for source in sources))
    check_output(out, force=force)
    scored, name = score_sources(sources, true, config), case or true.name
    estimated = {source.name: source.path.name for source in sources}
    results = results_of(name, scored, {"truth": truth.name, "estimates": estimated})
    with atomic_dir(out, force=force, inputs=inputs) as folder:
        write_results(folder, results)
        files = files_in(folder, ("results.json", "results.csv"))
        page = trajectory_page(name, true.trajectory, scored, command, files)
        (folder / REPORT_NAME).write_text(page_text(page), encoding="utf-8")
    return WrittenScores(name, scored, results)


def trajectory_page(
    case: str, truth: Trajectory, scored: Scored, command: str, files: tuple[str, ...]
) -> Page:
    """What the page shows."""
    sections = (
        ("path", "Path", "Estimates after alignment. The side view looks along y, with z up.",
         svg(path_figure, truth, scored)),
        ("errors", "Errors over time", "Absolute errors of every pose after alignment. A line that "
         "is interrupted has no poses there.", svg(errors_figure, truth, scored)),
        ("steps", "Errors over way", "Relative errors of all steps of one length, which no "
         "alignment changes: quartiles, with whiskers from 5 to 95 %.", svg(boxes_figure, scored)),
    )  # fmt: skip
    return Page(
        title=f"Trajectories of {case}",
        subtitle=how(next(iter(scored.values()))),
        blocks=(
            Sentences(tuple(sentences(scored))),
            overview_grid(scored),
            Sentences(tuple(notes(scored)), "note"),
        ),
        sections=(
            *(
                Section(name, title, (Text(about), Plot(drawing, title)))
                for name, title, about, drawing in sections
            ),
            Section("metrics", "All metrics", (metrics_grid(scored),)),
            made_here(command),
        ),
        files=files,
    )


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
        share, drift = (
            "undefined" if math.isnan(value) else f"{significant(value, 3)} %"
            for value in (values["ate_share"], values["drift"])
        )
        yield (
            f"{method}: ATE {significant(100 * values['ate_rmse'], 3)} cm, or {share}, of a path "
            f"of {significant(values['way'], 3)} m; drift {drift}; "
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
    lines = (
        (named_cell(method), *(cells[name][k] for name in COLUMNS))
        for k, method in enumerate(scored)
    )
    return grid((Head("estimate"), *(head.head() for head in heads)), lines)


def metrics_grid(scored: Scored) -> Grid:
    """A line for each metric, with what it is."""
    heads = [column(score.metric) for score in next(iter(scored.values())).scores]
    lines = ((head.title, head.unit, *_cells(scored, head.name), head.formula) for head in heads)
    return grid(("metric", "unit", *map(Head, scored), "what it is"), lines)


def _cells(scored: Scored, name: str) -> list[GridCell]:
    rows = [next(row for row in found.scores if row.metric == name) for found in scored.values()]
    top = best((row.value for row in rows), rows[0].direction) if len(rows) > 1 else math.nan
    return [value_cell(row.value, row.unit, top) for row in rows]
