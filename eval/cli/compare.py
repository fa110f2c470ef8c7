"""`eventsweep compare`: results side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from eval.cli.app import COMMON, NO_NEGATIVE, Common, app


@app.command
def compare(
    results: Annotated[tuple[Path, ...], NO_NEGATIVE],
    /,
    *,
    out: Path,
    common: Common = COMMON,
) -> None:
    """Write compare.html and tables of two or more results, with differences to the first.

    Args:
        results: Folders of `run`, `score` or `suite`, or their results.json or suite.json.
        out: Folder to write: compare.html and tables/.
    """
    from eval.report.compare_page import write_comparison

    common.console().wrote(write_comparison(results, out))
