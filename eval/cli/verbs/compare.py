"""`eventsweep compare`: results side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common, app


@app.command
def compare(
    results: Annotated[tuple[Path, ...], NO_NEGATIVE],
    /,
    *,
    out: Path,
    common: Common = COMMON,
) -> None:
    """Compare two or more results: what differs, and how sure that is; writes compare.html.

    Args:
        results: Folders of `run`, `score` or `suite`, or their results.json or suite.json.
        out: Folder to write: compare.html and tables/.
    """
    from eventsweep.eval.report.compare.page import HTML_NAME, write_comparison

    console = common.console()
    console.compared(write_comparison(results, out))
    console.wrote(out / HTML_NAME)
