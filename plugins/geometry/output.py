"""Files of geometries, scored: what the terminal shows, results and a page with pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.errors import InputError, located, repeated
from eventsweep.emvs.utils.outputs import atomic_dir, check_output
from eventsweep.eval.progress import SILENT, Display
from eventsweep.eval.report.html import REPORT_NAME, files_in, page_text
from eventsweep.eval.results.results import Results, Sample, write_results
from eventsweep.eval.results.table import tidy
from eventsweep.plugins.geometry.config import GeometryConfig
from eventsweep.plugins.geometry.page import ScoredGeometry, WrittenGeometries, geometry_page
from eventsweep.plugins.geometry.readers import Geometry, read_geometry
from eventsweep.plugins.geometry.score import Align, Judge, metric_versions, rows_of
from eventsweep.plugins.geometry.surfels import Surfels
from eventsweep.plugins.geometry.truth import cached_surfaces, open_sequence, write_truth

TRUTH_FILE = "truth.ply"


def score_files(
    asked: Sequence[str], truth: Path, out: Path | None, config: GeometryConfig, *,
    align: Align = "none", case: str | None = None, force: bool = False, command: str = "",
    progress: Display = SILENT,
) -> WrittenGeometries:  # fmt: skip
    """Scores geometries against a sequence; with `out` writes results, a page and the truth.

    Args:
        asked: `FILE` or `NAME=FILE`, as `read_geometry` takes them.
        truth: folder of a sequence.
        out: folder to write; None writes nothing.
        config: how.
        align: how each geometry is aligned first.
        case: what the results call the sequence; by default its name.
        force: whether an output of ours in its place is replaced.
        command: what the page says that made it.
        progress: where to show it.

    Raises:
        InputError: what the readers refuse, no truth, or an output that is in the way.
    """
    if out is None and config.write_truth:
        needed = "write_truth needs a folder to write into: set out"
        raise InputError(needed, parameter="write_truth")
    if out is not None:
        check_output(out, force=force)
    sequence = open_sequence(truth)
    geometries = [read_geometry(one, config) for one in asked]
    if (twice := repeated([one.name for one in geometries])) is not None:
        raise InputError(f"two geometries are called {twice}: give them names as in NAME=FILE")
    judge = Judge(_surfaces(sequence, config, progress))
    surfaces, scored = judge.truth, _scored(judge, geometries, align, progress)
    written = _written(case or sequence.name, sequence, surfaces, scored, config, align)
    if out is not None:
        inputs = (truth, *(one.path for one in geometries))
        with atomic_dir(out, force=force, inputs=inputs) as folder:
            _write(folder, written, sequence, surfaces, config, command)
    return written


def _surfaces(sequence: EventSequence, config: GeometryConfig, progress: Display) -> Surfels:
    with progress.stage("truth", 1) as update:
        return cached_surfaces(
            sequence, config.cell_m, config.far_m,
            lambda _stage, done, total: update(done / total, f"{done} of {total} pictures"),
        )  # fmt: skip


def _scored(
    judge: Judge, geometries: Sequence[Geometry], align: Align, progress: Display
) -> tuple[ScoredGeometry, ...]:
    scored = []
    with progress.stage("score", len(geometries)) as update:
        for done, one in enumerate(geometries):
            update(done, one.name)
            with located(one.path):
                found = judge.score(one.points, align)
            by_metric = {score.metric: score for score in judge.scores(found, align)}
            scored.append(ScoredGeometry(one, found, by_metric))
    return tuple(scored)


def _written(
    case: str, sequence: EventSequence, surfaces: Surfels, scored: tuple[ScoredGeometry, ...],
    config: GeometryConfig, align: Align,
) -> WrittenGeometries:  # fmt: skip
    settings = {**config.model_dump(mode="json", exclude={"write_truth"}), "align": align}
    about = {
        "true_points": len(surfaces),
        "geometries": {one.geometry.name: one.geometry.about for one in scored},
        "notes": {one.geometry.name: list(one.found.notes) for one in scored},
    }
    sample = Sample(case, sequence=sequence.manifest.digest(), metrics=dict(metric_versions()))
    rows = tidy(
        row for one in scored for row in rows_of(case, one.geometry.name, iter(one.scores.values()))
    )
    results = Results(rows, {"score": settings, case: about}, (sample,))
    left_out = all("segmentation" in sequence.truth_names(k) for k in range(len(sequence.rig)))
    moving = "left out" if left_out else "not left out: no segmentation is stored"
    how = (
        f"{len(surfaces):,} true points, one per cell of {100 * config.cell_m:g} cm; what may move "
        f"by itself is {moving}; "
        + "; ".join(f"{one.geometry.name}: {one.geometry.about}" for one in scored)
    )
    return WrittenGeometries(case, results, scored, how)


def _write(
    folder: Path, written: WrittenGeometries, sequence: EventSequence, surfaces: Surfels,
    config: GeometryConfig, command: str,
) -> None:  # fmt: skip
    write_results(folder, written.results)
    if config.write_truth:
        write_truth(folder / TRUTH_FILE, surfaces)
    files = files_in(folder, ("results.json", "results.csv", TRUTH_FILE))
    page = geometry_page(written, sequence, surfaces, command, files)
    (folder / REPORT_NAME).write_text(page_text(page), encoding="utf-8")
