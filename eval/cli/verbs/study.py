"""`eventsweep study`: what happens to every method when one thing is perturbed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from eventsweep.emvs.utils.outputs import output_folder
from eventsweep.eval.cli import names
from eventsweep.eval.cli.app import COMMON, Common, Methods, Poses, Scenes, app
from eventsweep.eval.cli.job_flags import JOB_FLAGS, JobFlags, seed_numbers
from eventsweep.eval.studies.definitions import CASES, METHODS, SECONDS, SEEDS, default_methods

if TYPE_CHECKING:
    from rich.table import Table

    from eventsweep.eval.studies.definitions import Study
    from eventsweep.eval.studies.run import StudyResult

_FAILED = 1


@app.command
def study(
    name: Annotated[tuple[str, ...], Parameter(negative=(), completer=names.studies)],
    /,
    *,
    out: Path,
    case: Scenes = (),
    seeds: str | None = None,
    seconds: float = SECONDS,
    method: Methods = (),
    poses: Poses = "true",
    job_flags: JobFlags = JOB_FLAGS,
    common: Common = COMMON,
) -> int:
    """Perturb one property by growing amounts and find where each method breaks.

    Args:
        name: Studies to run, such as pose-noise, or `all`; `eventsweep list studies`.
        out: Folder to write: NAME.png, .svg, .csv and .json for each study.
        case: Scene to run instead of boxes, desk and planes, repeatable.
        seeds: Seeds instead of 0,1,2, such as 0-9.
        seconds: Length of every sequence; the window leaves 0.05 s at either end.
        method: Method to compare, repeatable, instead of a choice of seven.
        poses: With `track`, poses are also found from events; they, and the maps made with them,
            are scored.
    """
    from eventsweep.eval.studies.definitions import STUDIES, study_named
    from eventsweep.eval.studies.run import file_names, run_study, write_study
    from eventsweep.eval.trackers import TRUE

    chosen = tuple(STUDIES) if name == ("all",) else name
    studies = [study_named(study) for study in chosen]
    console, failed = common.console(), 0
    compared = method or default_methods()
    job_flags.check()
    for lacking in () if method else [name for name in METHODS if name not in compared]:
        console.warn(f"{lacking} is left out: no plug-in that is installed has it")
    samples = (compared, case or CASES, seed_numbers(seeds, "--seeds") or SEEDS)
    files = [name for chosen_study in studies for name in file_names(chosen_study)]
    with output_folder(out, files, force=True):
        for chosen_study in studies:
            result = run_study(
                chosen_study, *samples, job_flags.open, console.progress, seconds,
                track=None if poses == TRUE else poses,
            )  # fmt: skip
            written = write_study(out, result)
            failed += len(result.failures)
            console.result(
                json.dumps({result.about.name: result.breaking()}),
                [_table(chosen_study, result)],
            )
            console.wrote(written[0])
    return _FAILED if failed else 0


def _table(perturbed: Study, result: StudyResult) -> Table:
    from eventsweep.eval.cli.console import table
    from eventsweep.eval.numbers import display_unit, displayed
    from eventsweep.eval.studies.curves import BREAKS_AT, METRICS

    breaking = result.breaking()
    mean_errors = [curve for curve in result.curves if curve.metric == METRICS[0]]
    unit = display_unit(mean_errors[0].unit)
    title = f"{perturbed.name}: mean error [{unit}] against {perturbed.axis} [{perturbed.unit}]"
    amounts = (f">{amount:g}" for amount in perturbed.amounts)
    rows = []
    for curve in mean_errors:
        at = breaking[curve.method]
        cells = (displayed(value, curve.unit) for value in curve.mean)
        rows.append((curve.method, *cells, "never" if at is None else f"{at:.3g}"))
    made = table(title, ("method", *amounts, f">x{BREAKS_AT:g} at"), rows)
    made.box = None
    return made
