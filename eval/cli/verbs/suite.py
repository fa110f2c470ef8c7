"""`eventsweep suite`: a frozen set of cases, run as jobs; `eventsweep cache`: their store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common, Force, Predictions, SuiteName, app
from eventsweep.eval.cli.job_flags import JOB_FLAGS, JobFlags, run_with_flags, seed_numbers

if TYPE_CHECKING:
    from eventsweep.eval.scoring.predictions import NamedFolder
    from eventsweep.eval.suite.archive import SequenceArchive
    from eventsweep.eval.suite.definition import Suite

_FAILED = 1


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
    force: Force = False,
    job_flags: JobFlags = JOB_FLAGS,
    common: Common = COMMON,
) -> int:
    """Run a suite of cases, or a subset; what is in the cache is not done again.

    Args:
        name: Such as quick, suite-v2, suite-v2:quick, or FILE.toml.
        out: Folder to write: suite.json, suite.csv and pictures.
        seeds: Seeds instead of the suite's own, such as 0,1,2 or 100-109.
        case: Only this case, repeatable.
        prediction: NAME=DIR, DIR or a submission with depth maps of another method; repeatable.
        archive: Folder of `archive make` or `fetch`: its sequences are used, none is simulated.
        list_cases: Only list what a prediction must hold; nothing is run.
        speed: Whether to time the mapper at the end.
        cost: Measure time and memory of each method alone, for a ranking: two minutes more.
    """
    from eventsweep.eval.suite.archive import SequenceArchive
    from eventsweep.eval.suite.definition import load

    chosen, subset = load(name)
    parts = Parts(
        chosen,
        subset,
        seed_numbers(seeds, "--seeds"),
        case,
        SequenceArchive(archive) if archive else None,
    )
    if list_cases and (out is not None or prediction):
        raise InputError("--list-cases with --out or --prediction: it only lists; leave one out")
    if list_cases:
        return _listed(parts, job_flags, common)
    if out is None:
        raise InputError("suite without --out: name a folder to write, or add --list-cases")
    return _run(
        parts, out, job_flags, common,
        name=name, prediction=prediction, speed=speed, cost=cost, force=force,
    )  # fmt: skip


class Parts(NamedTuple):
    """What of a suite is asked for, and where its sequences are."""

    suite: Suite
    subset: str
    seeds: tuple[int, ...] | None
    cases: tuple[str, ...]
    archive: SequenceArchive | None


def _listed(parts: Parts, job_flags: JobFlags, common: Common) -> int:
    from eventsweep.eval.suite import output

    asked = (parts.suite, parts.subset, parts.seeds, parts.cases)
    listed = output.assignments(*asked, job_flags.cache_folder(), parts.archive)
    output.show_assignments(listed, as_json=common.json, quiet=common.quiet)
    return 0


def _run(
    parts: Parts,
    out: Path,
    job_flags: JobFlags,
    common: Common,
    *,
    name: str,
    prediction: tuple[str, ...],
    speed: bool,
    cost: bool,
    force: bool,
) -> int:
    from eventsweep.eval.report.suite_pictures import write_pictures
    from eventsweep.eval.scoring.predictions import NamedFolder
    from eventsweep.eval.suite import output
    from eventsweep.eval.suite.cost import measured_costs
    from eventsweep.eval.suite.submission import perfect_scores

    suite, cache, console = parts.suite, job_flags.cache_folder(), common.console()
    entered = [NamedFolder.of(one) for one in prediction]
    given, stated = _opened(parts, entered, cache)
    inputs = (Path(name), *(one.path for one in entered))
    with output.prepare_folder(out, force=force, inputs=inputs) as folder:
        result = run_with_flags(
            suite, parts.subset, job_flags, console.progress, seeds=parts.seeds,
            cases=parts.cases, speed=speed, predictions=given, archive=parts.archive,
        )  # fmt: skip
        result = replace(result, stated=stated)
        if cost:
            costs = measured_costs(result, suite, cache, console.progress, parts.archive)
            result = replace(result, cost=costs)
        output.write(folder, result, force=force)
        with console.progress.stage("pictures", 1):
            write_pictures(folder, suite, result, given, cache, parts.archive)
    for method, places in perfect_scores(result.rows).items():
        console.warn(f"{method}: a perfect score, as of copied truth, in {', '.join(places)}")
    output.show(result, cache, as_json=common.json, quiet=common.quiet)
    console.wrote(folder / "suite.json")
    return _FAILED if result.failures else 0


def _opened(
    parts: Parts, entered: Sequence[NamedFolder], cache: Path
) -> tuple[list[NamedFolder], dict[str, Any]]:
    """Predictions as folders, and what submissions among them state."""
    from eventsweep.emvs.utils.cache import Cache
    from eventsweep.eval.suite.run import extent
    from eventsweep.eval.suite.submission import Asked, opened

    version = parts.archive.manifest.version if parts.archive else ""
    cases, seeds = extent(*parts)
    asked = Asked(parts.suite, cases, seeds, version)
    return opened(entered, asked, Cache(cache)) if entered else ([], {})


@app.command
def cache(
    *, cache: Path | None = None, prune: float | None = None, common: Common = COMMON
) -> None:
    """Show how much the suite's cache holds, and shrink it on request.

    Args:
        cache: The cache's folder; by default $EVENTSWEEP_CACHE or your cache folder.
        prune: Gigabytes to keep; the least recently used entries are removed; 0: all.
    """
    from eventsweep.emvs.utils.cache import Cache, default_cache
    from eventsweep.eval.suite.output import show_cache

    store = Cache(cache or default_cache())
    if prune is not None and prune < 0:
        raise InputError(f"--prune {prune:g}: gigabytes to keep, 0 or more")
    freed = 0 if prune is None else store.prune(round(prune * 1e9))
    show_cache(store.folder, store.size_bytes(), freed, as_json=common.json, quiet=common.quiet)
