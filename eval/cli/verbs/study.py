"""`eventsweep study`: what happens to every method when one thing is perturbed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from eventsweep.emvs.utils.outputs import output_folder
from eventsweep.eval.cli import names
from eventsweep.eval.cli.app import COMMON, Common, Methods, Scenes, app
from eventsweep.eval.cli.job_flags import JOB_FLAGS, JobFlags, seed_numbers
from eventsweep.eval.studies.definitions import CASES, METHODS, SECONDS, SEEDS

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
    job_flags: JobFlags = JOB_FLAGS,
    common: Common = COMMON,
) -> int:
    """Perturb one thing by growing amounts and see where each method breaks.

    Args:
        name: Studies to run, such as pose-noise, or `all`; `eventsweep list studies`.
        out: Folder to write: NAME.png, .svg, .csv and .json for each study.
        case: Scene to run instead of boxes, desk and planes, repeatable.
        seeds: Seeds instead of 0,1,2, such as 0-9.
        seconds: Length of every sequence; the window leaves 0.05 s at either end.
        method: Method to compare, repeatable, instead of a choice of five.
    """
    from eventsweep.eval.studies.definitions import STUDIES, study_named
    from eventsweep.eval.studies.run import file_names, run_study, show_study, write_study

    chosen = tuple(STUDIES) if name == ("all",) else name
    studies = [study_named(study) for study in chosen]
    samples = (method or METHODS, case or CASES, seed_numbers(seeds, "--seeds") or SEEDS)
    console, failed = common.console(), 0
    files = [name for one in studies for name in file_names(one)]
    with output_folder(out, files, force=True):
        for one in studies:
            result = run_study(one, *samples, job_flags.open, console.progress, seconds)
            written = write_study(out, result)
            failed += len(result.failures)
            show_study(result, as_json=common.json, quiet=common.quiet)
            console.wrote(written[0])
    return _FAILED if failed else 0
