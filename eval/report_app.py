"""What `eventsweep report` does: finds out what a folder holds and writes its page."""

from __future__ import annotations

from pathlib import Path

from emvs.errors import InputError
from eval.report import write_report
from eval.report_files import (
    FIGURES_FOLDER,
    TABLES_FOLDER,
    FigureFormat,
    write_report_figures,
    write_report_tables,
)
from eval.report_study import find_studies, write_study_report
from eval.rerun_recording import write_rerun


def write_all(
    folder: Path, *, tables: bool, figures: FigureFormat | None, rrd: bool = False
) -> list[Path]:
    """Writes a folder's page, and beside it what was asked for.

    Args:
        folder: of a run, a map or studies.
        tables: whether to write the rankings as files.
        figures: format of the figures' files; None for none.
        rrd: whether to write a recording for the Rerun viewer.

    Returns:
        The page, the folders of the tables and figures, and the recording.

    Raises:
        InputError: the folder holds nothing that has a page, or studies, which have their
            files already.
    """
    if find_studies(folder):
        if tables or figures or rrd:
            raise InputError(
                f"{folder}: --tables, --figures and --rrd are for runs; `study` writes its own "
                "files"
            )
        return [write_study_report(folder)]
    written = [write_report(folder)]
    if tables:
        write_report_tables(folder)
        written.append(folder / TABLES_FOLDER)
    if figures:
        write_report_figures(folder, figures)
        written.append(folder / FIGURES_FOLDER)
    if rrd:
        written.append(write_rerun(folder))
    return written
