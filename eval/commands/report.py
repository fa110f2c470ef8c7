"""`eventsweep report`: the page of a folder, written anew."""

from __future__ import annotations

from pathlib import Path

from eval.app import COMMON, Common, app


@app.command
def report(folder: Path, /, *, common: Common = COMMON) -> None:
    """Write report.html from the maps and results of a folder.

    Args:
        folder: What `run` or `map` wrote; report.html in it is written anew.
    """
    from eval.report import write_report

    console = common.console()
    console.wrote(write_report(folder))
