"""`eventsweep report`: the page of a folder, written anew."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from eval.app import COMMON, Common, app


@app.command
def report(
    folder: Path,
    /,
    *,
    tables: Annotated[bool, Parameter(negative=())] = False,
    figures: Literal["svg", "pdf"] | None = None,
    rrd: Annotated[bool, Parameter(negative=())] = False,
    common: Common = COMMON,
) -> None:
    """Write report.html from the maps and results, or from the studies, of a folder.

    Args:
        folder: What `run`, `map` or `study` wrote; report.html in it is written anew.
        tables: Also write the rankings of a run to tables/, as CSV, LaTeX and Markdown.
        figures: Also write curves, causes and slices of a run to figures/, as SVG or PDF.
        rrd: Also write recording.rrd for the Rerun viewer; needs eventsweep[rerun].
    """
    from eval.report_app import write_all

    for path in write_all(folder, tables=tables, figures=figures, rrd=rrd):
        common.console().wrote(path)
