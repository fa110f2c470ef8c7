"""What a study prints."""

from __future__ import annotations

import json
import sys

from rich.console import Console
from rich.table import Table
from rich.text import Text

from eval.studies.curves import BREAKS_AT, METRICS
from eval.studies.run import StudyResult


def show(result: StudyResult, *, as_json: bool, quiet: bool) -> None:
    """Prints each method's mean error over the amounts, and where it breaks."""
    if as_json:
        sys.stdout.write(json.dumps({result.study.name: result.breaking()}) + "\n")
        return
    if quiet:
        return
    study, breaking = result.study, result.breaking()
    shown = [curve for curve in result.curves if curve.metric == METRICS[0]]
    title = f"{study.name}: mean error [{shown[0].unit}] against {study.axis} [{study.unit}]"
    table = Table(title=Text(title), title_justify="left", box=None)
    table.add_column("method")
    for amount in study.amounts:
        table.add_column(f"{amount:g}", justify="right")
    table.add_column(f"x{BREAKS_AT:g} at", justify="right")
    for curve in shown:
        at = breaking[curve.method]
        cells = [f"{value:.3g}" for value in curve.mean]
        table.add_row(curve.method, *cells, "never" if at is None else f"{at:.3g}")
    Console().print(table)
