"""`eventsweep compare`: results side by side."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common, Force, app
from eventsweep.eval.cli.table_flags import TABLE_FLAGS, TableFlags

if TYPE_CHECKING:
    from rich.table import Table

    from eventsweep.eval.cli.console import Part
    from eventsweep.eval.report.compare.differences import Pair
    from eventsweep.eval.report.compare.page import Comparison


@app.command
def compare(
    results: Annotated[tuple[Path, ...], NO_NEGATIVE],
    /,
    *,
    out: Path | None = None,
    case: Annotated[tuple[str, ...], NO_NEGATIVE] = (),
    force: Force = False,
    table: TableFlags = TABLE_FLAGS,
    common: Common = COMMON,
) -> None:
    """Compare results: what differs, and how sure that is; and methods in a table for a paper.

    Args:
        results: Folders of `run`, `score` or `suite`, or their results.json or suite.json; with
            --table one will do.
        out: Folder to write: compare.html and tables/.
        case: Only this case in the table, repeatable.
    """
    from eventsweep.eval.report.compare.page import HTML_NAME, facts_of, write_comparison
    from eventsweep.eval.report.compare.results import names_of
    from eventsweep.eval.results.results import read_results

    if out is None and not table.table:
        raise InputError("compare writes a page or a table: add --out DIR or --table FILE.tex")
    table.check(force=force, cases=case)
    console = common.console()
    if out is not None:
        comparison = write_comparison(results, out)
        console.result(facts_of(comparison), _summary(comparison))
        console.wrote(out / HTML_NAME)
    if table.table:
        table.write(
            dict(zip(names_of(results), map(read_results, results), strict=True)), console,
            force=force, cases=case,
        )  # fmt: skip


def _summary(comparison: Comparison) -> Iterator[Part]:
    from eventsweep.eval.cli.console import dim
    from eventsweep.eval.report.compare import page

    for pair in comparison.pairs:
        yield page.lead_text(pair)
        yield _differences(pair)
        yield from map(dim, (page.verdict_text(pair), *pair.data, *pair.only_in_one))
    yield page.settings_text(comparison)


def _differences(pair: Pair) -> Table:
    """One line per method, of the first metric that is judged."""
    from eventsweep.eval.cli.console import table
    from eventsweep.eval.numbers import displayed
    from eventsweep.eval.report import ranking
    from eventsweep.eval.report.compare.differences import interval_text, signed

    metric = pair.headline[0].metric if pair.headline else ""
    chosen = [line for line in pair.headline if line.metric == metric]
    title = ""
    for line in chosen[:1]:
        head = ranking.column(metric)
        title = f"{line.case}, {head.title} in {head.unit}, {line.direction} is better"
    columns = (
        "method", f">{pair.first.name}", f">{pair.other.name}", ">Δ", ">95 % of Δ", "verdict",
    )  # fmt: skip
    rows = (
        (
            line.method, displayed(line.first, line.unit), displayed(line.other, line.unit),
            signed(line.change, line.unit), interval_text(line), line.short_label,
        )
        for line in chosen
    )  # fmt: skip
    return table(title, columns, rows)
