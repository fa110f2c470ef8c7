"""`eventsweep paper`: measures every statement of the paper on its twins."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common, Force
from eventsweep.eval.cli.job_flags import JOB_FLAGS, JobFlags, run_with_flags, seed_numbers

PAGE, SUITE = "paper.md", Path(__file__).with_name("paper-v1.toml")
_FAILED = 1


def paper(
    *,
    out: Path,
    seeds: str | None = None,
    case: Annotated[tuple[str, ...], NO_NEGATIVE] = (),
    force: Force = False,
    job_flags: JobFlags = JOB_FLAGS,
    common: Common = COMMON,
) -> int:
    """Measure what the paper states, statement by statement, and draw its figures.

    Finished jobs come from the cache. Statements whose cases are left out are not measured.

    Args:
        out: Folder to write: paper.md, pictures, suite.json and suite.csv.
        seeds: Seeds instead of the suite's own, such as 3,4.
        case: Only this case, repeatable.
    """
    from eventsweep.emvs.utils.cache import Cache
    from eventsweep.emvs.utils.outputs import atomic_dir, files_together, output_folder
    from eventsweep.eval.report.suite_pictures import CaseViews
    from eventsweep.eval.results.results import PICTURES_FOLDER, SUITE_CSV, SUITE_NAME
    from eventsweep.eval.suite import output
    from eventsweep.eval.suite.definition import load
    from eventsweep.plugins.paper.evidence import Evidence
    from eventsweep.plugins.paper.page import page

    suite, subset = load(str(SUITE))
    console = common.console()
    with output_folder(out, (SUITE_NAME, SUITE_CSV, PICTURES_FOLDER, PAGE), force=force) as folder:
        result = run_with_flags(
            suite, subset, job_flags, console.progress,
            seeds=seed_numbers(seeds, "--seeds"), cases=case, speed=False,
        )  # fmt: skip
        views = CaseViews(suite, (), Cache(job_flags.cache_folder()), None)
        with console.progress.stage("statements", 1):
            made = page(Evidence(result, views), PICTURES_FOLDER)
        output.write(folder, result, force=force)
        with atomic_dir(folder / PICTURES_FOLDER, force=True, part_of=folder) as pictures:
            for name, content in made.pictures.items():
                (pictures / name).write_bytes(content)
        with files_together(folder, (PAGE,)) as staged:
            (staged / PAGE).write_text(made.text, encoding="utf-8")
    facts = {verdict.value: count for verdict, count in made.verdicts.items()}
    words = (f"{verdict}: {count}" for verdict, count in facts.items() if count)
    console.result({"verdicts": facts}, [f"statements: {'; '.join(words)}"])
    console.wrote(folder / PAGE)
    return _FAILED if result.failures else 0
