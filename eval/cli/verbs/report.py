"""`eventsweep report`: the page of a folder, written anew."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import NO_NEGATIVE, QUIET, Quiet, app
from eventsweep.eval.progress import Display


@Parameter(name="*")
@dataclass(frozen=True)
class ReportFlags:
    """What to write beside the page of a run."""

    tables: Annotated[bool, NO_NEGATIVE] = False
    "Also write the rankings of a run to tables/, as CSV, LaTeX and Markdown."

    figures: Literal["svg", "pdf"] | None = None
    "Also write curves, causes and slices of a run to figures/, as SVG or PDF."

    rrd: Annotated[bool, NO_NEGATIVE] = False
    "Also write recording.rrd for the Rerun viewer; needs eventsweep[rerun]."


_PAGE_ONLY = ReportFlags()


def report_stage(progress: Display) -> Callable[[Path], None]:
    """What writes the report of a folder, shown as a stage of its own."""

    def write(folder: Path) -> None:
        # Its figures need matplotlib: 0.3 s before the first event, were it imported at the top.
        from eventsweep.eval.report.run_page import write_report

        with progress.stage("report", 1):
            write_report(folder)

    return write


@app.command
def report(folder: Path, /, *, flags: ReportFlags = _PAGE_ONLY, common: Quiet = QUIET) -> None:
    """Write report.html for a folder that `run`, `map`, `suite` or `study` wrote.

    Args:
        folder: The folder; report.html in it is replaced.
    """
    from eventsweep.eval.report.study_page import write_study_report
    from eventsweep.eval.report.suite_page import is_suite_folder, write_suite_report
    from eventsweep.eval.studies.stored import find_studies

    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; `run`, `map`, `suite` and `study` write one")
    if is_suite_folder(folder):
        written = _page_only(write_suite_report, folder, flags, "suite")
    elif find_studies(folder):
        written = _page_only(write_study_report, folder, flags, "study")
    else:
        written = _of_run(folder, flags)
    for path in written:
        common.console().wrote(path)


def _page_only(
    write: Callable[[Path], Path], folder: Path, flags: ReportFlags, verb: str
) -> list[Path]:
    if flags != _PAGE_ONLY:
        raise InputError(
            f"{folder}: --tables, --figures and --rrd are for runs; `{verb}` writes its own files"
        )
    return [write(folder)]


def _of_run(folder: Path, flags: ReportFlags) -> list[Path]:
    from eventsweep.emvs.utils.outputs import check_files
    from eventsweep.eval.report import tables
    from eventsweep.eval.report.rerun import write_rerun
    from eventsweep.eval.report.run_data import load_run
    from eventsweep.eval.report.run_page import write_report

    asked = {"tables": flags.tables, "figures": flags.figures, "recording.rrd": flags.rrd}
    check_files(folder, [name for name, wanted in asked.items() if wanted], force=True)
    written = [write_report(folder)]
    if flags.tables:
        place = folder / tables.TABLES_FOLDER
        tables.write_tables(place, tables.report_tables(load_run(folder)))
        written.append(place)
    if flags.figures:
        tables.write_report_figures(folder, flags.figures)
        written.append(folder / tables.FIGURES_FOLDER)
    if flags.rrd:
        written.append(write_rerun(folder))
    return written
