"""`eventsweep ranking`: results of a suite as one page: who is ahead, where, and at what cost."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common, app


@app.command
def ranking(
    results: Annotated[tuple[str, ...], NO_NEGATIVE],
    /,
    *,
    out: Path,
    common: Common = COMMON,
) -> None:
    """Rank the methods of one or more results; writes index.html and ranking.json.

    Args:
        results: Folders of `suite` or of earlier rankings, oldest first, or LABEL=FOLDER.
        out: Folder to write: index.html, ranking.json and pictures.
    """
    from eventsweep.eval.ranking.entries import read_source
    from eventsweep.eval.report.standings.page import HTML_NAME, write_ranking

    page = write_ranking([read_source(one) for one in results], out)
    console = common.console()
    console.ranked(page.public)
    console.wrote(out / HTML_NAME)
