"""`eventsweep ranking`: results of a suite as one page: who is ahead, where, and at what cost."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Part
    from eventsweep.plugins.ranking.summary import Ranked


def ranking(
    results: Annotated[tuple[str, ...], NO_NEGATIVE],
    /,
    *,
    out: Path,
    site: str = "",
    common: Common = COMMON,
) -> None:
    """Rank the methods of one or more results; writes index.html, ranking.json and methods/.

    Args:
        results: Folders of `suite`, of scores as CASE/seedN, or of earlier rankings, oldest first;
            or LABEL=FOLDER.
        out: Folder to write: index.html, ranking.json, a page for every method and pictures.
        site: Address or folder of the documentation, for links to the rules and home.
    """
    from eventsweep.plugins.ranking.pages.page import HTML_NAME, write_ranking
    from eventsweep.plugins.ranking.sources import read_source

    page = write_ranking([read_source(result) for result in results], out, site)
    console = common.console()
    facts = _facts(page.public)
    if page.tracks:
        facts["tracks"] = {name: _facts(found) for name, found in page.tracks.items()}
    parts = (_summary(found, f"{name}: ") for name, found in page.tracks.items())
    console.result(facts, chain(_summary(page.public), *parts))
    console.wrote(out / HTML_NAME)


def _facts(ranked: Ranked) -> dict[str, Any]:
    standings = [
        {"method": row.method, "rank": row.rank, "mean_place": round(row.place, 4)}
        for row in ranked.standings
    ]
    refused = dict(ranked.joined.refused)
    return {"standings": standings, "not_ranked": ranked.lacking, "refused": refused}


def _summary(ranked: Ranked, track: str = "") -> Iterator[Part]:
    from eventsweep.eval.cli.console import table
    from eventsweep.eval.report.ranking import heading

    rows = ((row.method, str(row.rank), f"{row.place:.2f}") for row in ranked.standings)
    if ranked.standings:
        title = f"{track}ranks by {heading(ranked.metric)}"
        yield table(title, ("method", ">rank", ">mean place"), rows)
    else:
        yield f"{track}no method was run on every case, so none is ranked"
    for label, why in ranked.joined.refused:
        yield f"{label}: {why}"
