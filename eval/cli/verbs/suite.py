"""`eventsweep suite`: a frozen set of cases, run as jobs; `eventsweep cache`: their store."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common, Force, Predictions, SuiteName, app
from eventsweep.eval.cli.help import RARE
from eventsweep.eval.cli.job_flags import JOB_FLAGS, JobFlags, run_with_flags, seed_numbers
from eventsweep.eval.cli.table_flags import TABLE_FLAGS, TableFlags

if TYPE_CHECKING:
    from rich.table import Table

    from eventsweep.eval.cli.console import Part
    from eventsweep.eval.results.results import Results
    from eventsweep.eval.results.series import Series
    from eventsweep.eval.suite.definition import Suite
    from eventsweep.eval.suite.packages import Wanted
    from eventsweep.eval.suite.source import SequenceSource

_FAILED = 1
_SHOWN = ("points", "median_error", "mean_error", "abs_rel", "bad_published", "completeness")


@app.command
def suite(
    name: SuiteName,
    /,
    *,
    out: Path | None = None,
    seeds: str | None = None,
    case: Annotated[tuple[str, ...], NO_NEGATIVE] = (),
    prediction: Predictions = (),
    archive: Path | None = None,
    list_cases: Annotated[bool, NO_NEGATIVE] = False,
    speed: bool = True,
    cost: Annotated[bool, NO_NEGATIVE] = False,
    so_far: Annotated[bool, NO_NEGATIVE, RARE] = False,
    force: Force = False,
    table: TableFlags = TABLE_FLAGS,
    job_flags: JobFlags = JOB_FLAGS,
    common: Common = COMMON,
) -> int:
    """Run a suite of cases, or a subset; finished jobs come from the cache.

    Args:
        name: Such as quick, suite-v5, suite-v5:quick, or FILE.toml.
        out: Folder to write: suite.json, suite.csv and pictures.
        seeds: Seeds instead of the suite's own, such as 0,1,2 or 100-109.
        case: Only this case, repeatable.
        prediction: NAME=DIR, DIR or a submission with depth maps of another method; repeatable.
        archive: Folder of `archive make` or `fetch`, whose sequences are used instead of
            simulating.
        list_cases: Only list what a prediction must hold; nothing is run.
        speed: Time the mapper at the end.
        cost: Measure time and memory of each method alone, for a ranking; takes two minutes more.
        so_far: Run nothing, and write what is done by now, also while the suite runs elsewhere.
    """
    from eventsweep.eval.report.ranking import column
    from eventsweep.eval.suite.definition import load
    from eventsweep.eval.suite.output import assignments
    from eventsweep.eval.suite.source import open_source

    table.check(force=force)
    for metric in table.metric:
        column(metric)  # refuses what is none before hours of jobs, not after them
    source = open_source(archive) if archive else None
    parts = Parts(*load(name), seed_numbers(seeds, "--seeds"), case, source)
    if list_cases and (out is not None or prediction):
        raise InputError("--list-cases with --out or --prediction: it only lists; leave one out")
    if list_cases:
        listed = assignments(*parts, cache=job_flags.cache_folder())
        common.console().result(listed, _assignments(listed))
        return 0
    if so_far and cost:
        raise InputError(
            "--cost with --so-far: one measures, the other runs nothing; leave one out"
        )
    if out is None:
        raise InputError("suite without --out: name a folder to write, or add --list-cases")
    return _run(
        parts, out, job_flags, common, table,
        prediction=prediction, speed=speed, cost=cost, so_far=so_far, force=force,
    )  # fmt: skip


class Parts(NamedTuple):
    """Which part of a suite is run, and where its sequences are."""

    suite: Suite
    subset: str
    seeds: tuple[int, ...] | None
    cases: tuple[str, ...]
    archive: SequenceSource | None

    def wanted(self) -> Wanted:
        """What a prediction must hold."""
        from eventsweep.eval.suite.packages import Wanted
        from eventsweep.eval.suite.plan import extent

        version = self.archive.facts.version if self.archive else ""
        return Wanted(self.suite, *extent(*self), version)


def _run(
    parts: Parts,
    out: Path,
    job_flags: JobFlags,
    common: Common,
    table: TableFlags,
    *,
    prediction: tuple[str, ...],
    speed: bool,
    cost: bool,
    so_far: bool,
    force: bool,
) -> int:
    from eventsweep.emvs.utils.cache import Cache
    from eventsweep.eval.report.suite_pictures import write_pictures
    from eventsweep.eval.suite import output
    from eventsweep.eval.suite.cost import measured_costs
    from eventsweep.eval.suite.packages import open_packages
    from eventsweep.eval.suite.predictions import perfect_scores

    suite, cache, console = parts.suite, job_flags.cache_folder(), common.console()
    given, stated = open_packages(prediction, parts.wanted(), Cache(cache))
    with output.prepare_folder(out, force=force) as folder:
        result = run_with_flags(
            suite, parts.subset, job_flags, console.progress, seeds=parts.seeds,
            cases=parts.cases, speed=speed, predictions=given, archive=parts.archive,
            so_far=so_far,
        )  # fmt: skip
        result = replace(result, stated=stated)
        if cost:
            costs = measured_costs(result, suite, cache, console.progress, parts.archive)
            result = replace(result, cost=costs)
        output.write(folder, result, force=force)
        with console.progress.stage("pictures", 1):
            write_pictures(folder, suite, result, given, cache, parts.archive)
    for method, places in perfect_scores(result.rows).items():
        console.warn(
            f"{method}: a perfect score, as if the truth were copied, in {', '.join(places)}"
        )
    console.result(_facts(result), _summary(result, cache))
    console.wrote(folder / "suite.json")
    table.write({suite.name: result}, console, force=force)
    return _FAILED if result.failures else 0


def _facts(result: Results) -> dict[str, Any]:
    return {
        **{name: getattr(result, name) for name in ("suite", "subset", "digest", "seeds")},
        "jobs": len(result.jobs),
        "found": sum(job.found for job in result.jobs),
        "failed": {job.name: job.failure for job in result.failures},
    }


def _summary(result: Results, cache: Path) -> Iterator[Part]:
    from rich.text import Text

    from eventsweep.emvs.utils.cache import Cache
    from eventsweep.emvs.utils.files import bytes_text
    from eventsweep.eval.jobs.job import NOT_YET
    from eventsweep.eval.results.series import measured_of

    series = measured_of(result).series.values()
    for case in result.cases:
        its = [one for one in series if one.case == case and one.metric in _SHOWN]
        if its:
            yield _table(case, its, max(len(one.values) for one in its))
    failed = [job for job in result.failures if not job.failure.endswith(NOT_YET)]
    for job in failed:
        yield Text(f"failed: {job.name}: {job.failure}", style="bold")
    made = sum(not job.found for job in result.jobs if not job.failure)
    missing = len(result.failures) - len(failed)
    not_yet = f", {missing} {NOT_YET}" if missing else ""
    yield (
        f"{result.suite} {result.subset}: {len(result.jobs)} jobs, {made} done now, "
        f"{len(failed)} failed{not_yet}; the cache {cache} holds "
        f"{bytes_text(Cache(cache).size_bytes())}"
    )


def _table(case: str, series: Iterable[Series], seeds: int) -> Table:
    from eventsweep.eval.cli.console import table
    from eventsweep.eval.numbers import display_unit
    from eventsweep.eval.report.ranking import heading

    cells: dict[str, dict[str, str]] = {}
    units: dict[str, str] = {}
    for numbers in series:
        cells.setdefault(numbers.method, {})[numbers.metric] = _mean_and_spread(numbers)
        units[numbers.metric] = display_unit(numbers.unit)
    many = f"mean over {seeds} seeds ± standard deviation"
    metrics = [metric for metric in _SHOWN if metric in units]
    headings = (f">{heading(metric)}\n{units[metric]}" for metric in metrics)
    rows = ((name, *(of.get(metric, "") for metric in metrics)) for name, of in cells.items())
    return table(f"{case}: {many if seeds > 1 else 'one seed'}", ("method", *headings), rows)


def _mean_and_spread(numbers: Series) -> str:
    from eventsweep.eval.numbers import displayed

    mean, spread = (displayed(value, numbers.unit) for value in (numbers.mean, numbers.spread))
    return mean if math.isnan(numbers.spread) else f"{mean} ± {spread}"


def _assignments(listed: Mapping[str, Any]) -> Iterator[Part]:
    """What a prediction must hold: a line for each case and window."""
    from eventsweep.eval.cli.console import table

    of_cases: dict[str, list[Any]] = {}
    for sequence in listed["sequences"]:
        of_cases.setdefault(sequence["case"], []).append(sequence)
    rows = [row for of_case in of_cases.values() for row in _windows(of_case)]
    columns = ("case", "seeds N", "size [px]", "file")
    yield table(f"{listed['suite']} {listed['subset']}", columns, rows)
    files = sum(len(sequence["windows"]) for sequence in listed["sequences"])
    there = sum(sequence["sequence"] is not None for sequence in listed["sequences"])
    yield (
        f"{files} depth maps; {there} of {len(listed['sequences'])} sequences are simulated. "
        "--json says where they are, with cameras, and times of windows."
    )


def _windows(seeds: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, ...]]:
    first, numbers = seeds[0], " ".join(str(sequence["seed"]) for sequence in seeds)
    size = f"{first['camera']['width_px']}×{first['camera']['height_px']}"
    for number, window in enumerate(first["windows"]):
        file = window["file"].replace(f"/seed{first['seed']}/", "/seedN/")
        yield (*((first["case"], numbers, size) if number == 0 else ("", "", "")), file)


@app.command
def cache(
    *, cache: Path | None = None, prune: float | None = None, common: Common = COMMON
) -> None:
    """Show how much the suite's cache holds, and shrink it on request.

    Args:
        cache: The cache's folder; by default $EVENTSWEEP_CACHE or your cache folder.
        prune: Gigabytes to keep; the least recently used entries are removed; 0 removes all.
    """
    from eventsweep.emvs.utils.cache import Cache, default_cache
    from eventsweep.emvs.utils.files import bytes_text

    store = Cache(cache or default_cache())
    if prune is not None and prune < 0:
        raise InputError(f"--prune {prune:g}: needs gigabytes to keep, 0 or more")
    freed = 0 if prune is None else store.prune(round(prune * 1e9))
    size = store.size_bytes()
    words = f"; freed {bytes_text(freed)}" if freed else ""
    facts = {"cache": str(store.folder), "bytes": size, "freed_bytes": freed}
    common.console().result(facts, [f"{store.folder}: {bytes_text(size)}{words}"])
