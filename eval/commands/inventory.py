"""`eventsweep list`: what there is."""

from __future__ import annotations

from eval.app import COMMON, Common, app


@app.command(name="list")
def list_everything(*, common: Common = COMMON) -> None:
    """List cases, rigs, methods and metrics."""
    from eval.inventory import inventory

    common.console().inventory(inventory())
