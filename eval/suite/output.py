"""What a suite's run leaves and prints."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console as RichConsole
from rich.table import Table

from eventsweep.emvs.utils.cache import Cache
from eventsweep.emvs.utils.files import bytes_text
from eventsweep.emvs.utils.outputs import check_files, files_together, output_folder
from eventsweep.eval.archives.manifest import ArchiveManifest, PackedSequence
from eventsweep.eval.jobs.job import SEQUENCE, stored
from eventsweep.eval.numbers import display_unit, displayed
from eventsweep.eval.scoring.results import write_csv
from eventsweep.eval.suite.archive import SequenceArchive
from eventsweep.eval.suite.definition import Suite
from eventsweep.eval.suite.predictions import assignment
from eventsweep.eval.suite.results import FILE_NAME, SuiteResult, write_suite
from eventsweep.eval.suite.run import extent, suite_jobs
from eventsweep.eval.suite.series import Series, of_suite
from eventsweep.eval.suite.submission import Asked, SubmissionFacts

CSV_NAME, PICTURES_FOLDER = "suite.csv", "pictures"
_CSV_COLUMNS = ("case", "seed", "window", "method", "metric", "value", "unit", "direction")
_SHOWN = ("points", "median_error", "mean_error", "abs_rel", "bad_published", "completeness")


@contextmanager
def prepare_folder(out: Path, *, force: bool, inputs: Iterable[Path] = ()) -> Iterator[Path]:
    """Claims a folder for results before the work begins; `write` makes it.

    Args:
        out: the folder.
        force: whether the result of another run is replaced.
        inputs: files that are read, which no result replaces.

    Raises:
        InputError: it holds a result already and `force` is not set, something else of that name,
            or cannot be written to.
    """
    names = (FILE_NAME, CSV_NAME, PICTURES_FOLDER)
    with output_folder(out, names, force=force, inputs=inputs) as folder:
        yield folder


def write(folder: Path, result: SuiteResult, *, force: bool = False) -> None:
    """Writes `suite.json`, with all that made the numbers, and `suite.csv` with the numbers."""
    check_files(folder, (FILE_NAME, CSV_NAME), force=force)
    with files_together(folder, (FILE_NAME, CSV_NAME)) as staged:
        write_suite(staged, result)
        write_csv(staged / CSV_NAME, result.rows[list(_CSV_COLUMNS)])


def show(result: SuiteResult, cache: Path, *, as_json: bool, quiet: bool) -> None:
    """Prints means and spreads over seeds, what failed, and how much the cache holds."""
    if quiet:
        return
    out = RichConsole(highlight=False)
    if as_json:
        facts = {
            "suite": result.suite,
            "subset": result.subset,
            "digest": result.digest,
            "seeds": result.seeds,
            "jobs": len(result.jobs),
            "found": sum(job.found for job in result.jobs),
            "failed": {job.name: job.failure for job in result.failures},
        }
        out.out(json.dumps(facts, indent=2, ensure_ascii=False), highlight=False)
        return
    for case in result.cases:
        found = [one for one in of_suite(result).series.values() if one.case == case]
        out.print(_table(case, found, result.seeds))
    for job in result.failures:
        out.print(f"failed: {job.name}: {job.failure}", style="bold", markup=False)
    made = sum(not job.found for job in result.jobs if not job.failure)
    out.print(
        f"{result.suite} {result.subset}: {len(result.jobs)} jobs, {made} done now, "
        f"{len(result.failures)} failed; the cache {cache} holds "
        f"{bytes_text(Cache(cache).size_bytes())}",
        markup=False,
        soft_wrap=True,
    )


def _table(case: str, series: Iterable[Series], seeds: Sequence[int]) -> Table:
    cells: dict[str, dict[str, str]] = {}
    units: dict[str, str] = {}
    for one in series:
        if one.metric in _SHOWN:
            cells.setdefault(one.method, {})[one.metric] = _mean_and_spread(one)
            units[one.metric] = display_unit(one.unit)
    many = f"mean over {len(seeds)} seeds ± standard deviation"
    title = f"{case}: {many if len(seeds) > 1 else 'one seed'}"
    table = Table(title=title, title_justify="left")
    table.add_column("method", no_wrap=True)
    metrics = [metric for metric in _SHOWN if metric in units]
    for metric in metrics:
        table.add_column(f"{metric.replace('_', ' ')}\n{units[metric]}", justify="right")
    for method, found in cells.items():
        table.add_row(method, *(found.get(metric, "") for metric in metrics))
    return table


def _mean_and_spread(one: Series) -> str:
    mean, spread = displayed(one.mean, one.unit), one.spread
    return mean if math.isnan(spread) else f"{mean} ± {displayed(spread, one.unit)}"


def assignments(
    suite: Suite,
    subset: str,
    seeds: Sequence[int] | None,
    cases: Sequence[str] | None,
    cache: Path,
    archive: SequenceArchive | None = None,
) -> dict[str, Any]:
    """What a prediction must hold, and where the cache has the sequences, as plain JSON values.

    Raises:
        InputError: an unknown subset or case.
    """
    listed = []
    for job in suite_jobs(suite, *extent(suite, subset, seeds, cases, archive), archive):
        made = stored(job.needs[0], Cache(cache)) if cache.is_dir() else None
        where = None if made is None else str(made.path / SEQUENCE)
        asked = assignment(suite, job.parameters["case"], job.parameters["seed"])
        listed.append({**asked.to_json(), "sequence": where})
    about = {"suite": suite.name, "subset": subset, "digest": suite.digest}
    return {"schema_version": 1, **about, "sequences": listed}


def show_assignments(listed: Mapping[str, Any], *, as_json: bool, quiet: bool) -> None:
    """Prints what a prediction must hold: a line for each case, or everything as JSON."""
    if quiet:
        return
    out = RichConsole(highlight=False)
    if as_json:
        out.out(json.dumps(listed, indent=2, ensure_ascii=False), highlight=False)
        return
    table = Table(title=f"{listed['suite']} {listed['subset']}", title_justify="left")
    for name in ("case", "seeds N", "size [px]", "file"):
        table.add_column(name, overflow="fold")
    for case in dict.fromkeys(one["case"] for one in listed["sequences"]):
        of_case = [one for one in listed["sequences"] if one["case"] == case]
        _add_assignment(table, of_case)
    out.print(table)
    files = sum(len(one["windows"]) for one in listed["sequences"])
    there = sum(one["sequence"] is not None for one in listed["sequences"])
    out.print(
        f"{files} depth maps; {there} of {len(listed['sequences'])} sequences are simulated. "
        "--json says where they are, with cameras, and times of windows.",
        markup=False,
        soft_wrap=True,
    )


def _add_assignment(table: Table, seeds: Sequence[Mapping[str, Any]]) -> None:
    first, numbers = seeds[0], " ".join(str(one["seed"]) for one in seeds)
    camera = first["camera"]
    size = f"{camera['width_px']}×{camera['height_px']}"
    for number, window in enumerate(first["windows"]):
        file = window["file"].replace(f"/seed{first['seed']}/", "/seedN/")
        about = (first["case"], numbers, size) if number == 0 else ("", "", "")
        table.add_row(*about, file)


def show_cache(cache: Path, size: int, freed: int, *, as_json: bool, quiet: bool) -> None:
    """Prints what a cache holds, and what pruning freed, in bytes."""
    if quiet:
        return
    out = RichConsole(highlight=False)
    if as_json:
        facts = {"cache": str(cache), "bytes": size, "freed_bytes": freed}
        out.out(json.dumps(facts, indent=2), highlight=False)
        return
    words = f"; freed {bytes_text(freed)}" if freed else ""
    out.print(f"{cache}: {bytes_text(size)}{words}", markup=False, soft_wrap=True)


def show_archive(
    manifest: ArchiveManifest,
    chosen: Sequence[PackedSequence],
    *,
    as_json: bool,
    quiet: bool,
) -> None:
    """Prints what an archive is, and how large the chosen part of it."""
    if quiet:
        return
    out = RichConsole(highlight=False)
    packed, unpacked = (
        sum(one.bytes for one in chosen), sum(one.unpacked_bytes for one in chosen)
    )  # fmt: skip
    if as_json:
        facts = {
            **manifest.model_dump(include={"suite", "digest", "part", "truth", "licence"}),
            "version": manifest.version,
            "sequences": [one.place for one in chosen],
            "bytes": packed,
            "unpacked_bytes": unpacked,
        }
        out.out(json.dumps(facts, indent=2), highlight=False)
        return
    out.print(
        f"{manifest.suite}, {manifest.part}, version {manifest.version}: {len(chosen)} of "
        f"{len(manifest.sequences)} sequences, {bytes_text(packed)}, {bytes_text(unpacked)} "
        f"unpacked; {manifest.licence}; {'with' if manifest.truth else 'without'} ground truth",
        markup=False,
        soft_wrap=True,
    )


def show_submission(facts: SubmissionFacts, asked: Asked, *, as_json: bool, quiet: bool) -> None:
    """Prints what a submission is, once all of it was found to be right."""
    if quiet:
        return
    out = RichConsole(highlight=False)
    maps = len(asked.views())
    if as_json:
        content = {**facts.model_dump(mode="json"), "suite": asked.suite.name, "depth_maps": maps}
        out.out(json.dumps(content, indent=2, ensure_ascii=False), highlight=False)
        return
    cost = facts.cost
    out.print(
        f"{facts.method} by {', '.join(facts.authors)}, {facts.licence}: {maps} depth maps for "
        f"{asked.suite.name} are complete; stated: {cost.seconds_per_window:g} s a window, "
        f"{cost.peak_memory_mb:g} MB, {cost.hardware}",
        markup=False,
        soft_wrap=True,
    )
