"""What a command prints: tables for people, JSON for scripts, nothing when told to be quiet."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console as RichConsole
from rich.markup import escape
from rich.table import Table

from eventsweep.eval.cli.exit_codes import with_flags
from eventsweep.eval.numbers import displayed, thousands
from eventsweep.eval.progress import Bars, Progress, Silent

if TYPE_CHECKING:
    import pandas as pd

    from eventsweep.emvs.check.findings import Finding, Report
    from eventsweep.emvs.maps.folder import StoredMap, StoredWindow
    from eventsweep.emvs.maps.merge import FusedInfo
    from eventsweep.eval.calibration import Calibrated
    from eventsweep.eval.ranking.summary import Ranked
    from eventsweep.eval.report.compare.differences import Pair
    from eventsweep.eval.report.compare.page import Comparison
    from eventsweep.eval.scoring.results import Results
    from eventsweep.sim.video.record import RecordedVideo

_MOST_SKIPPED_SHOWN = 5
_NAME_WIDTH = 30
_UNWRAPPED = 1000
"""Columns of what another program reads: a line for each name, for `grep`."""


class Console:
    """Summaries on standard output, progress on the error stream."""

    def __init__(self, *, quiet: bool, as_json: bool) -> None:
        self._show = not (quiet or as_json)
        self._as_json = as_json
        self._out = RichConsole(soft_wrap=False, highlight=False)
        self.progress: Progress = Bars(with_flags) if self._show else Silent()

    def results(self, results: Results, ranking_metric: str) -> None:
        """The ranking of each case, and what it says in words."""
        # Here as everywhere in this file: no command waits for what another one prints.
        from eventsweep.eval.report import ranking
        from eventsweep.eval.scoring.results import POOLED, to_json

        if self._as_json:
            self._out.out(to_json(results), end="", highlight=False)
        pooled = results.rows[results.rows["window"] == POOLED]
        for case in pooled["case"].unique() if self._show else ():
            rows = pooled[pooled["case"] == case]
            self._out.print(_ranking(case, rows, ranking_metric))
            for sentence in ranking.findings(rows, ranking_metric):
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
        self._dump({"map": str(stored.path), **map_facts(stored)})
        if self._show:
            for part in map_tables(stored):
                self._out.print(part)

    def checked(self, report: Report) -> None:
        """Every finding, and of those that are not good what to do."""
        self._dump(report.to_json())
        if not self._show:
            return
        self._out.print(_checked(report))
        for one in (*report.of("wrong"), *report.of("doubtful")):
            self._out.print(with_flags(one.line()), markup=False, soft_wrap=True)
        for name, why in report.unchecked:
            words = with_flags(f"not checked: {name}, because {why}")
            self._out.print(words, style="dim", markup=False, soft_wrap=True)

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
        from eventsweep.emvs.data.sequence import Sequence as EventSequence

        sequence = EventSequence.open(path)
        counts = sequence.manifest.event_counts
        t0_us, t1_us = sequence.manifest.span_us
        facts = {
            "sequence": str(path),
            "events": list(counts),
            "duration_s": (t1_us - t0_us) * 1e-6,
            "renderer": sequence.manifest.renderer,
            "sha256": sequence.manifest.digest(),
        }
        self._dump(facts)
        if self._show:
            each = " + ".join(map(thousands, counts))
            self._out.print(f"{sequence.name}: {each} events in {facts['duration_s']:g} s, {path}")
            drawn_by = f"drawn by {sequence.manifest.renderer}"
            self._out.print(drawn_by, style="dim", markup=False, soft_wrap=True)

    def recorded(self, recorded: RecordedVideo) -> None:
        """What became of a video, and what to know of it."""
        self._dump(recorded.facts())
        if self._show:
            size = f"{recorded.width_px}x{recorded.height_px} px"
            lasting_s = (recorded.span_us[1] - recorded.span_us[0]) * 1e-6
            self._out.print(
                f"{recorded.events:,} events of {recorded.frames:,} frames, {size}, in "
                f"{lasting_s:g} s, {recorded.path}",
                markup=False, soft_wrap=True,
            )  # fmt: skip
            self._out.print(
                f"times: {recorded.time_base}; values: {recorded.encoding}; "
                f"{recorded.lost_at_half_rate:.0%} fewer events at half the frame rate",
                style="dim", markup=False, soft_wrap=True,
            )  # fmt: skip
        for note in recorded.notes:
            self.warn(with_flags(note))

    def calibrated(self, calibrated: Calibrated) -> None:
        """Each parameter with its correction and uncertainty, or why it was refused."""
        from eventsweep.eval.calibration import facts_of

        self._dump(facts_of(calibrated))
        if not self._show:
            return
        self._out.print(_estimates(calibrated))
        for one in calibrated.refinement.estimates:
            if one.refused:
                words = f"{one.parameter.name} stays as given: {one.refused}"
                self._out.print(words, style="dim", markup=False, soft_wrap=True)

    def compared(self, comparison: Comparison) -> None:
        """Which settings differ, and the verdict of each method's ranking number."""
        from eventsweep.eval.report.compare import page as compare_page

        self._dump(compare_page.facts_of(comparison))
        if not self._show:
            return
        self._out.print(compare_page.settings_text(comparison), markup=False, soft_wrap=True)
        for pair in comparison.pairs:
            self._out.print(_compared(pair))
            for sentence in (compare_page.verdict_text(pair), *pair.data, *pair.only_in_one):
                self._out.print(sentence, style="dim", markup=False, soft_wrap=True)

    def ranked(self, ranked: Ranked) -> None:
        """Who is ahead, with ties."""
        standings = [
            {"method": one.method, "rank": one.rank, "other_seeds": [one.low_rank, one.high_rank],
             "mean_place": round(one.place, 4)}
            for one in ranked.standings
        ]  # fmt: skip
        refused = dict(ranked.joined.refused)
        facts = {"standings": standings, "not_ranked": ranked.lacking, "refused": refused}
        self._dump(facts)
        if not self._show:
            return
        table = Table(title=f"ranks by {ranked.metric.replace('_', ' ')}", title_justify="left")
        for name in ("method", "rank", "mean place"):
            table.add_column(name, justify="left" if name == "method" else "right")
        for one in ranked.standings:
            table.add_row(escape(one.method), str(one.rank), f"{one.place:.2f}")
        self._out.print(table)
        for label, why in ranked.joined.refused:
            self._out.print(f"{label}: {why}", markup=False, soft_wrap=True)

    def inventory(self, kinds: Mapping[str, Mapping[str, str]]) -> None:
        """Everything there is to choose from."""
        self._dump(kinds)
        out = self._out
        if not out.is_terminal:
            out = RichConsole(highlight=False, width=_UNWRAPPED)
        for kind, lines in kinds.items() if self._show else ():
            table = Table(title=kind, title_justify="left", show_header=False, box=None)
            table.add_column(style="bold", max_width=_NAME_WIDTH if out.is_terminal else None)
            table.add_column()
            for name, text in lines.items():
                table.add_row(escape(name), escape(text))
            out.print(table, "")

    def say(self, line: str) -> None:
        """A line for people."""
        if self._show:
            self._out.print(line, markup=False, soft_wrap=True)

    def wrote(self, path: Path) -> None:
        """Where to look."""
        if self._show:
            self._out.print(f"wrote {path}")

    def warn(self, note: str) -> None:
        """What is wrong with what was written, on the error stream, however quiet."""
        sys.stderr.write(f"note: {note}\n")

    def doubt(self, finding: Finding) -> None:
        """What is doubtful or wrong with a recording, in one line on the error stream."""
        sys.stderr.write(f"check: {with_flags(finding.line())}\n")

    def _dump(self, facts: Any) -> None:
        if self._as_json:
            self._out.out(json.dumps(facts, indent=2, ensure_ascii=False), highlight=False)


# As many as fit 80 characters; the report has them all.
_COLUMNS = ("points", "mean_error", "common_mean_error", "median_error", "abs_rel", "bad_published")


def _ranking(case: str, rows: pd.DataFrame, metric: str) -> Table:
    from eventsweep.eval.report import ranking

    content = ranking.table(rows, metric, _COLUMNS)
    table = Table(title=f"{case}, by {ranking.column(metric).title}", title_justify="left")
    table.add_column("method", no_wrap=True)
    arrows = {"lower": "↓", "higher": "↑", "none": ""}
    for column in content.columns:
        table.add_column(
            f"{column.title} {arrows[column.direction]}\n{column.unit}", justify="right"
        )
    for line in content.lines:
        cells = (f"[bold]{cell.text}" if cell.best else cell.text for cell in line.cells)
        table.add_row(line.method, *cells)
    return table


def _estimates(calibrated: Calibrated) -> Table:
    table = Table(title="calibration", title_justify="left")
    table.add_column("parameter")
    for name in ("correction", "95 % ±", "unit"):
        table.add_column(name, justify="right")
    for one in calibrated.refinement.estimates:
        value = "refused" if one.refused else f"{one.value:+.3f}"
        cells = (one.parameter.name, value, f"{one.uncertainty:.3f}", one.parameter.unit)
        table.add_row(*map(escape, cells))
    return table


_VERDICT_STYLES = {"good": "green", "doubtful": "yellow", "wrong": "bold red"}


def _checked(report: Report) -> Table:
    table = Table(title=f"check of {escape(report.name)}", title_justify="left")
    table.add_column("what", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("evidence", overflow="fold")
    for one in report.findings:
        style = _VERDICT_STYLES[one.verdict]
        table.add_row(one.name, f"[{style}]{one.verdict}", escape(with_flags(one.evidence)))
    return table


def _compared(pair: Pair) -> Table:
    """One line per method, of the first metric that is judged."""
    from eventsweep.eval.report import ranking
    from eventsweep.eval.report.compare.differences import interval_text, signed

    metric = pair.headline[0].metric if pair.headline else ""
    found = [one for one in pair.headline if one.metric == metric]
    table = Table(title_justify="left")
    for one in found[:1]:
        head = ranking.column(metric)
        table.title = escape(f"{one.case}, {head.title} in {head.unit}, {one.direction} is better")
    names = (pair.first.name, pair.other.name, "Δ")
    table.add_column("method", no_wrap=True)
    for name in (*names, "95 % of Δ"):
        table.add_column(escape(name), justify="right")
    table.add_column("verdict")
    for one in found:
        values = [displayed(value, one.unit) for value in (one.first, one.other)]
        change = signed(one.change, one.unit)
        cells = (one.method, *values, change, interval_text(one), one.short_label)
        table.add_row(*map(escape, cells))
    return table


def map_facts(stored: StoredMap) -> dict[str, Any]:
    """Every window with its counts and points, and what was left out."""
    info = stored.info
    return {
        "windows": [
            {
                **window.info.model_dump(mode="json", exclude={"methods", "points"}),
                "points": _points_of(window),
            }
            for window in stored.windows
        ],
        "skipped": [window.model_dump(mode="json") for window in info.skipped],
        "hot_pixels": {
            camera: {"pixels": len(hot.pixels), "events": hot.events}
            for camera, hot in info.hot_pixels.items()
        },
        "without_pose": info.without_pose,
        "complete": info.complete,
    }


def map_tables(stored: StoredMap) -> Iterator[Table | str]:
    """One window in full; of several, sums and ranges, and which were skipped and why."""
    info, windows = stored.info, stored.windows
    points = [_points_of(window) for window in windows]
    counts = [window.info.counts for window in windows]
    title = "event statistics"
    if info.config.slides:
        title += f", summed over {len(windows)} windows"
    yield _counts(title, counts)
    yield _points(points)
    for camera, hot in info.hot_pixels.items():
        yield f"{camera}: {len(hot.pixels):,} hot pixels dropped, with {hot.events:,} events"
    for camera, events in info.without_pose.items():
        if events:
            yield f"{camera}: {events:,} events before the first or after the last pose left out"
    yield from _skipped(stored)


def _points_of(window: StoredWindow) -> dict[str, int]:
    """Points per method; maps of older versions do not say it in their index."""
    methods = window.info.methods
    return window.info.points or {name: window.depth_map(name).points for name in methods}


def _skipped(stored: StoredMap) -> Iterator[str]:
    skipped = stored.info.skipped
    if not skipped:
        return
    total = len(skipped) + len(stored.windows)
    yield f"[bold]{len(skipped)} of {total} windows could not be mapped:"
    for window in skipped[:_MOST_SKIPPED_SHOWN]:
        yield f"{window.name}: {escape(window.reason)}"
    if len(skipped) > _MOST_SKIPPED_SHOWN:
        yield f"and {len(skipped) - _MOST_SKIPPED_SHOWN} more, see map.json"


def _counts(title: str, windows: Sequence[Mapping[str, Mapping[str, int]]]) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("")
    for camera in windows[0]:
        table.add_column(camera, justify="right")
    for name in next(iter(windows[0].values())):
        cells = (f"{sum(counts[camera][name] for counts in windows):,}" for camera in windows[0])
        table.add_row(name.replace("_", " "), *cells)
    return table


def _points(windows: Sequence[Mapping[str, int]]) -> Table:
    table = Table(title="points", title_justify="left")
    table.add_column("method")
    if len(windows) == 1:
        table.add_column("pixels with depth", justify="right")
        for name, count in windows[0].items():
            table.add_row(name, f"{count:,}")
        return table
    for name in ("fewest", "median", "most"):
        table.add_column(f"{name} pixels\nwith depth", justify="right")
    for name in windows[0]:
        counts = sorted(points[name] for points in windows)
        shown = (counts[0], counts[len(counts) // 2], counts[-1])
        table.add_row(name, *(f"{count:,}" for count in shown))
    return table
