"""`eventsweep list`: what there is to choose from by name."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import app
from eventsweep.eval.cli.names import KINDS


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
        raise InputError(f"nothing called {unknown!r} to list: choose from {', '.join(KINDS)}")
    wanted = {name: dict(KINDS[name]()) for name in kind or KINDS}
    Console(quiet=False, as_json=json).inventory(wanted)
