"""What a command prints: tables for people, JSON for scripts, nothing when told to be quiet."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console as RichConsole
from rich.markup import escape
from rich.table import Table

from emvs.data.sequence import Sequence as EventSequence
from emvs.maps.folder import StoredMap
from eval import map_summary
from eval.exits import with_flags
from eval.progress import Bars, Progress, Silent
from eval.report import ranking
from eval.report import ranking as findings
from eval.scoring.results import Results, Row, to_json
from eval.scoring.score import POOLED

if TYPE_CHECKING:
    from emvs.maps.merge import FusedInfo


class Console:
    """Summaries on standard output, progress on the error stream."""

    def __init__(self, *, quiet: bool, as_json: bool) -> None:
        self._show = not (quiet or as_json)
        self._as_json = as_json
        self._out = RichConsole(soft_wrap=False, highlight=False)
        self.progress: Progress = Bars(with_flags) if self._show else Silent()

    def results(self, results: Results, ranking_metric: str) -> None:
        """The ranking of each case, and what it says in words."""
        if self._as_json:
            self._out.out(to_json(results), end="", highlight=False)
        for case in dict.fromkeys(row.case for row in results.rows) if self._show else ():
            rows = [row for row in results.rows if row.case == case and row.window == POOLED]
            self._out.print(_ranking(case, rows, ranking_metric))
            for sentence in findings.findings(rows, ranking_metric):
                self._out.print(sentence, style="dim")
            counts = results.configuration.get(case, {}).get("windows")
            if counts is not None:
                lacking, scored = counts["without_truth"], counts["scored"]
                self._out.print(
                    f"{scored} of {scored + lacking} windows scored: {lacking} have no ground "
                    "truth at their reference time."
                )

    def mapped(self, stored: StoredMap) -> None:
        """Event statistics, how many points each method found, and what was left out."""
        self._dump({"map": str(stored.path), **map_summary.facts(stored)})
        if self._show:
            for part in map_summary.tables(stored):
                self._out.print(part)

    def fused(self, path: Path, info: FusedInfo) -> None:
        """What joining the windows of a map gave."""
        self._dump({"path": str(path), **info.model_dump(mode="json")})
        if self._show:
            mesh = "" if info.triangles is None else f", a mesh of {info.triangles:,} triangles"
            self._out.print(
                f"{info.method}: {info.window_points:,} points of {info.windows} windows, "
                f"{info.points:,} voxels of {info.config.voxel_m:g} m{mesh}, in {path}"
            )

    def sequence(self, path: Path) -> None:
        """What a sequence holds."""
        sequence = EventSequence.open(path)
        counts = sequence.manifest.event_counts
        t0_us, t1_us = sequence.trajectory.span_us
        facts = {
            "sequence": str(path),
            "events": list(counts),
            "duration_s": (t1_us - t0_us) * 1e-6,
            "renderer": sequence.manifest.renderer,
            "sha256": sequence.manifest.digest(),
        }
        self._dump(facts)
        if self._show:
            each = " + ".join(f"{count:,}" for count in counts).replace(",", " ")
            self._out.print(f"{sequence.name}: {each} events in {facts['duration_s']:g} s, {path}")
            drawn_by = f"drawn by {sequence.manifest.renderer}"
            self._out.print(drawn_by, style="dim", markup=False, soft_wrap=True)

    def inventory(self, kinds: Mapping[str, Mapping[str, str]]) -> None:
        """Everything there is to choose from."""
        self._dump(kinds)
        for kind, lines in kinds.items() if self._show else ():
            table = Table(title=kind, title_justify="left", show_header=False, box=None)
            for name, text in lines.items():
                table.add_row(f"[bold]{escape(name)}", escape(text))
            self._out.print(table, "")

    def wrote(self, path: Path) -> None:
        """Where to look."""
        if self._show:
            self._out.print(f"wrote {path}")

    def _dump(self, facts: Any) -> None:
        if self._as_json:
            self._out.out(json.dumps(facts, indent=2, ensure_ascii=False), highlight=False)


# As many as fit 80 characters; the report has them all.
_COLUMNS = ("points", "mean_error", "common_mean_error", "median_error", "abs_rel", "bad_published")


def _ranking(case: str, rows: Sequence[Row], metric: str) -> Table:
    content = ranking.table(rows, metric, _COLUMNS)
    table = Table(title=f"{case}, by {ranking.column(metric).title}", title_justify="left")
    table.add_column("method", no_wrap=True)
    arrows = {"lower": "↓", "higher": "↑", "none": ""}
    for column in content.columns:
        table.add_column(f"{column.title} {arrows[column.better]}\n{column.unit}", justify="right")
    for line in content.lines:
        cells = (f"[bold]{cell.text}" if cell.best else cell.text for cell in line.cells)
        table.add_row(line.method, *cells)
    return table
