"""Several runs side by side: same case and method, with differences where they mean something."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from emvs.errors import InputError
from emvs.utils.files import atomic_path
from emvs.utils.outputs import output_folder
from eval.figures.colormaps import line_style
from eval.gate.compare import Status, Tolerances, Verdict, compare
from eval.report.html import (
    Grid,
    GridCell,
    Head,
    Kind,
    Page,
    Section,
    page_text,
    plural,
    versions_grid,
)
from eval.report.ranking import RANKING_COLUMNS, column, definition, heading, shown
from eval.report.tables import TABLES_FOLDER, TextCell, TextTable, in_unit, write_tables
from eval.suite.series import Key, Measured, Series, read_measured

HTML_NAME = "compare.html"
_NOTE = (
    "Better and worse are said as the gate says them: by more than seeds differ, or by more than "
    "2 % where there is one seed. What was measured on other sequences, by another definition or "
    "by other code is not comparable, whatever its numbers. Values are means over seeds; "
    "differences are over the seeds of the later result, where the first one has them all."
)
_VERDICT, _MOST_CHANGES, _CHOSEN = "verdict", 200, "mean_error"
_TEXTS = ("case", "method", "metric", _VERDICT, "why")
_KINDS: dict[str, Kind] = {"better": "better", "worse": "worse", "same": ""}
JUDGED = ("better", "worse", "same")
"""Verdicts of two numbers that can be compared."""


@dataclass(frozen=True, slots=True)
class ComparedRun:
    """A result, and what the page calls it."""

    name: str
    measured: Measured


@dataclass(frozen=True)
class RunComparison:
    """Results, each held against the first.

    Attributes:
        runs: the results, the first one is the reference.
        verdicts: per further result, what it says of each number.
    """

    runs: tuple[ComparedRun, ...]
    verdicts: tuple[Mapping[Key, Verdict], ...]


def write_comparison(paths: Sequence[Path], out: Path) -> Path:
    """Writes `compare.html` and `tables/` into a folder and returns the page's path.

    Raises:
        InputError: fewer than two results, one is missing or damaged, or a file of another's is in
            the way.
    """
    with output_folder(out, (HTML_NAME, TABLES_FOLDER), force=True):
        comparison = compare_runs(read_runs(paths))
        text = page_text(comparison_page(comparison))
        with atomic_path(out / HTML_NAME) as path:
            path.write_text(text, encoding="utf-8")
        write_tables(out / TABLES_FOLDER, comparison_tables(comparison))
    return out / HTML_NAME


def read_runs(paths: Sequence[Path]) -> tuple[ComparedRun, ...]:
    """Reads results and names them after their folders.

    Raises:
        InputError: fewer than two, or one is missing or damaged.
    """
    if len(paths) < 2:
        raise InputError(f"{len(paths)} result given, needs two or more to compare")
    folders = [path.resolve() if path.is_dir() else path.resolve().parent for path in paths]
    names = [folder.name for folder in folders]
    if len(set(names)) < len(names):
        names = [f"{k + 1}: {'/'.join(folder.parts[-2:])}" for k, folder in enumerate(folders)]
    read = (read_measured(path) for path in paths)
    return tuple(ComparedRun(name, one) for name, one in zip(names, read, strict=True))


def compare_runs(runs: Sequence[ComparedRun]) -> RunComparison:
    """Judges every number of each further run against the first, as the gate would."""
    first, *others = runs
    verdicts = tuple(_verdicts(first.measured, other.measured) for other in others)
    return RunComparison(tuple(runs), verdicts)


def _verdicts(first: Measured, other: Measured) -> dict[Key, Verdict]:
    judged = compare(first.series, other, Tolerances())
    strange = {one.key.case for one in judged if one.status == "not comparable"}
    strange -= {one.key.case for one in judged if one.status in JUDGED}
    # What is missing on another sequence is no loss.
    verdicts = (
        Verdict(one.key, "not comparable", one.unit)
        if one.status == "gone" and one.key.case in strange else one
        for one in judged
    )  # fmt: skip
    directed = (one for one in verdicts if _has_direction(one, first, other))
    return {one.key: _with_versions(one, first, other) for one in directed}


def _has_direction(verdict: Verdict, first: Measured, other: Measured) -> bool:
    """Whether more or less is better: of what has no direction, no change is for the worse."""
    series = first.series.get(verdict.key) or other.series.get(verdict.key)
    return series is None or series.better != "none"


def _with_versions(verdict: Verdict, first: Measured, other: Measured) -> Verdict:
    """A plain run says nothing of its metrics' code, so another version is another yardstick."""
    if verdict.status == "not comparable":
        return replace(verdict, why="other sequences, another definition or another metric")
    versions = [one.versions.get("eventsweep", "") for one in (first, other)]
    suites = first.name != "results" and other.name != "results"
    if suites or versions[0] == versions[1] or verdict.status not in JUDGED:
        return verdict
    why = f"scored by eventsweep {versions[0]} and {versions[1]}"
    return Verdict(verdict.key, "not comparable", verdict.unit, why=why)


def comparison_page(comparison: RunComparison) -> Page:
    """What the page shows: a section per case, in it a table per metric."""
    names = [run.name for run in comparison.runs]
    cases = list(dict.fromkeys(key.case for run in comparison.runs for key in run.measured.series))
    sections = [_section(comparison, case, k) for k, case in enumerate(cases)]
    return Page(
        title=" against ".join((names[0], ", ".join(names[1:]))),
        subtitle=f"{len(names)} results; differences are to {names[0]}.",
        sections=(*(section for section in sections if section.names), _changes(comparison)),
        provenance=versions_grid(names, [run.measured.versions for run in comparison.runs]),
        overview=_overview(comparison),
        findings=tuple(_sentence(comparison, k) for k in range(len(comparison.verdicts))),
        note=_NOTE,
        version=comparison.runs[0].measured.versions.get("eventsweep", ""),
    )


def comparison_tables(comparison: RunComparison) -> dict[str, TextTable]:
    """One table per case and metric."""
    tables = {}
    for section in comparison_page(comparison).sections[:-1]:
        metrics = metrics_of(comparison, section.title)
        for metric, name, grid in zip(metrics, section.names, section.tables, strict=True):
            heads = tuple(f"{h.title} [{h.unit}]" if h.unit else h.title for h in grid.heads)
            lines = tuple(
                (TextCell(line[0].text, line[0].text), *map(_text_cell, line[1:], grid.heads[1:]))
                for line in grid.lines
            )
            caption = f"{section.title}: {name}"
            tables[f"{section.title}-{metric}"] = TextTable(caption, heads, lines)
    return tables


def _text_cell(cell: GridCell, head: Head) -> TextCell:
    value = cell.text if head.title == _VERDICT else in_unit(cell.value, head.unit)
    return TextCell(cell.text, value)


def metrics_of(comparison: RunComparison, case: str) -> list[str]:
    """The metrics of a case that people rank by, those of the ranking first."""
    present = {
        key.metric for run in comparison.runs for key in run.measured.series if key.case == case
    }
    return [name for name in RANKING_COLUMNS if name in present]


def _changes(comparison: RunComparison) -> Section:
    """What differs most, whatever it is, one table per result."""
    names = tuple(run.name for run in comparison.runs[1:])
    grids = tuple(map(_changed, comparison.verdicts))
    text = (
        f"Everything that is not the same, the most telling first, up to {_MOST_CHANGES} lines. "
        "Δ is now less before; up to the tolerance, either way, two numbers are the same."
    )
    return Section("changes", "What differs", names, grids, text, choice="Result")


def _changed(verdicts: Mapping[Key, Verdict]) -> Grid:
    titles = ("case", "method", "metric", "before", "now", "Δ", "tolerance", _VERDICT, "why")
    heads = tuple(Head(title, text=title in _TEXTS) for title in titles)
    alone = [one for one in verdicts.values() if one.status not in ("same", "not comparable")]
    apart = [one for one in verdicts.values() if one.status == "not comparable"]
    lines = [*map(_changed_line, alone[:_MOST_CHANGES]), *_not_comparable(apart)]
    return Grid(heads, tuple(lines))


def _not_comparable(verdicts: Sequence[Verdict]) -> Iterator[tuple[GridCell, ...]]:
    """One line per case, method and reason: hundreds of lines would say no more."""
    groups = Counter((one.key.case, one.key.method, one.why) for one in verdicts)
    for (case, method, why), count in groups.items():
        texts = (case, method, plural(count, "metric"), "–", "–", "–", "–")
        cells = (GridCell(text) for text in texts)
        yield (*cells, GridCell("not comparable", kind="other"), GridCell(why))


def _changed_line(one: Verdict) -> tuple[GridCell, ...]:
    kind = _KINDS.get(one.status, "other")
    numbers = (one.baseline, one.value, one.change, one.tolerance)
    cells = (GridCell(_plain(value, one.unit), value) for value in numbers)
    key = (GridCell(text) for text in (one.key.case, one.key.method, heading(one.key.metric)))
    return (*key, *cells, GridCell(one.status, kind=kind), GridCell(one.why))


def _plain(value: float, unit: str) -> str:
    return "–" if math.isnan(value) else f"{value:.4g} {unit}".rstrip().replace("-", "−")


def _section(comparison: RunComparison, case: str, position: int) -> Section:
    metrics = metrics_of(comparison, case)
    grids = tuple(_grid(comparison, case, metric) for metric in metrics)
    titles = tuple(column(metric).title for metric in metrics)
    chosen = metrics.index(_CHOSEN) if _CHOSEN in metrics else 0
    return Section(f"case{position}", case, titles, grids, chosen=chosen)


def _grid(comparison: RunComparison, case: str, metric: str) -> Grid:
    head = column(metric)
    first, *others = (run.name for run in comparison.runs)
    heads = [Head("method"), Head(first, head.unit, head.better, arrow=True)]
    for name in others:
        heads.append(Head(name, head.unit, head.better, arrow=True))
        heads += [Head("Δ", head.unit), Head("Δ", "%")]
        heads.append(Head(_VERDICT, text=True))
    keys = dict.fromkeys(
        key for run in comparison.runs for key in run.measured.series
        if (key.case, key.metric) == (case, metric)
    )  # fmt: skip
    return Grid(
        tuple(heads), tuple(_line(comparison, key) for key in keys), _about(comparison, metric)
    )


def _about(comparison: RunComparison, metric: str) -> str:
    """What the numbers of a table are, and of how many seeds."""
    counts = {len(run.measured.seeds) for run in comparison.runs}
    seeds = " or ".join(map(str, sorted(counts)))
    return f"{definition(metric)} Means over {seeds} seed{'s' * (counts != {1})}."


def _line(comparison: RunComparison, key: Key) -> tuple[GridCell, ...]:
    colour = line_style(key.method).css
    first, *others = (run.measured.series.get(key) for run in comparison.runs)
    cells = [GridCell(key.method, colour=colour), _value(first)]
    for verdicts, series in zip(comparison.verdicts, others, strict=True):
        cells += [_value(series), *_difference(verdicts.get(key), first, series)]
    return tuple(cells)


def _value(series: Series | None) -> GridCell:
    if series is None:
        return GridCell("–")
    mean = series.mean
    return GridCell(shown(mean, series.unit), mean)


def _difference(
    verdict: Verdict | None, first: Series | None, other: Series | None
) -> tuple[GridCell, GridCell, GridCell]:
    status: Status = verdict.status if verdict else "not comparable"
    if first is None or other is None or status not in JUDGED or verdict is None:
        nothing = GridCell("–")
        return nothing, nothing, GridCell(status, kind="other")
    kind, change = _KINDS[status], verdict.change
    share = 100 * change / abs(verdict.baseline) if verdict.baseline else math.nan
    sign = "+" if change > 0 else "−" if change < 0 else ""
    text = sign + shown(abs(change), first.unit)
    relative = "–" if math.isnan(share) else f"{sign}{abs(share):.1f}"
    return (
        GridCell(text, change, kind),
        GridCell(relative, share, kind),
        GridCell(status, kind=kind),
    )


def _overview(comparison: RunComparison) -> Grid:
    statuses: tuple[Status, ...] = (
        "better", "same", "worse", "not comparable", "new", "gone", "failed",
    )  # fmt: skip
    lines = []
    for run, verdicts in zip(comparison.runs[1:], comparison.verdicts, strict=True):
        counts = (sum(one.status == status for one in verdicts.values()) for status in statuses)
        cells = (GridCell(str(count), float(count)) for count in counts)
        lines.append((GridCell(run.name), *cells))
    return Grid(
        (Head("numbers that are"), *(Head(s, "", "higher") for s in statuses)), tuple(lines)
    )


def _sentence(comparison: RunComparison, position: int) -> str:
    run, verdicts = comparison.runs[position + 1], comparison.verdicts[position].values()
    reasons = {one.why for one in verdicts if one.status == "not comparable"}
    counts = {s: sum(one.status == s for one in verdicts) for s in ("better", "worse", "same")}
    words = ", ".join(f"{count} {status}" for status, count in counts.items() if count)
    text = f"{run.name} against {comparison.runs[0].name}: {words or 'nothing is comparable'}"
    return text + (f"; not comparable: {'; '.join(sorted(reasons))}." if reasons else ".")
