"""`eventsweep list`: what there is to choose from by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import app
from eventsweep.eval.cli.names import KINDS

if TYPE_CHECKING:
    from rich.table import Table

_NAME_WIDTH = 30
_PIPED_WIDTH = 1000  # a line for each name, for `grep`


@app.command(name="list")
def list_names(
    kind: Annotated[tuple[str, ...], Parameter(negative=(), choices=tuple(KINDS))] = (),
    /,
    *,
    json: Annotated[bool, Parameter(group="Common", negative=())] = False,
) -> None:
    """List scenes, rigs, methods, metrics and everything else that is chosen by name.

    Args:
        kind: What to list; by default everything.
        json: Print names and descriptions as JSON.
    """
    from eventsweep.eval.cli.console import Console

    unknown = next((one for one in kind if one not in KINDS), None)
    if unknown is not None:
        raise InputError(f"cannot list {unknown!r}: choose from {', '.join(KINDS)}")
    wanted = {name: dict(KINDS[name]()) for name in kind or KINDS}
    console = Console(quiet=False, as_json=json, piped_width=_PIPED_WIDTH)
    narrow = console.is_terminal
    tables = (part for name in wanted for part in (_table(name, wanted[name], narrow), ""))
    console.result(wanted, tables)


def _table(kind: str, lines: Mapping[str, str], narrow: bool) -> Table:
    from rich.table import Table

    table = Table(title=kind, title_justify="left", show_header=False, box=None)
    table.add_column(style="bold", max_width=_NAME_WIDTH if narrow else None)
    table.add_column()
    for name, text in lines.items():
        table.add_row(name, text)
    return table
