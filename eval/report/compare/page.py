"""The page of results side by side: settings, numbers with how sure they are, pictures."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from eventsweep.emvs.utils.outputs import files_together, output_folder
from eventsweep.eval.figures.colormaps import line_style
from eventsweep.eval.numbers import displayed
from eventsweep.eval.report.compare.differences import (
    JUDGED,
    Difference,
    Pair,
    compare_results,
    counts_of,
    signed,
)
from eventsweep.eval.report.compare.pictures import pictures_of
from eventsweep.eval.report.compare.results import ComparedResult, read_compared
from eventsweep.eval.report.compare.settings import Setting, settings_of
from eventsweep.eval.report.html import Grid, GridCell, Head, Kind, Section, plural, render
from eventsweep.eval.report.ranking import RANKING_COLUMNS, column, definition
from eventsweep.eval.report.tables import TABLES_FOLDER, write_tables
from eventsweep.eval.results.results import JSON_NAME, SUITE_NAME
from eventsweep.eval.scoring.metrics import PRIMARY

HTML_NAME = "compare.html"
VERDICT = "verdict"
_MOST_SETTINGS = 5
_KINDS: Mapping[str, Kind] = {"better": "better", "worse": "worse", "equal": ""}
_NOTE = (
    "Values are means over the seeds that both results have and, within a seed, over the windows "
    "that both have; a run's own report pools the pixels of all windows instead. Δ is the other "
    "value minus the first, and its 95 % interval comes from pairs of the same seed and window. "
    "With one seed there is no interval, and another seed may show something else. Only {judged} "
    "are judged: better or worse means that the interval excludes zero and that p, from a t-test "
    "over seeds, is below 0.05 after correction for all numbers that are judged beside it (Holm), "
    "separately for means of cases and for single cases. The intervals are not corrected: one in "
    "twenty excludes zero by chance. “No difference shown” does not mean that there is none. Read "
    "errors together with points: a method that reports fewer pixels has chosen easier ones."
)


@dataclass(frozen=True)
class Comparison:
    """A comparison of several results; the first is the reference of every pair."""

    results: tuple[ComparedResult, ...]
    pairs: tuple[Pair, ...]
    settings: tuple[Setting, ...]

    @property
    def differing(self) -> tuple[Setting, ...]:
        """The settings that differ."""
        return tuple(one for one in self.settings if one.differs)

    @property
    def names(self) -> tuple[str, ...]:
        """What the results are called."""
        return tuple(result.name for result in self.results)


def write_comparison(paths: Sequence[Path], out: Path) -> Comparison:
    """Writes `compare.html` and `tables/` into a folder, and returns what they say."""
    with output_folder(out, (HTML_NAME, TABLES_FOLDER), force=True):
        comparison = compare(read_compared(paths))
        text = page_text(comparison, _result_files(comparison, out))
        with files_together(out, (HTML_NAME,)) as staged:
            (staged / HTML_NAME).write_text(text, encoding="utf-8")
        write_tables(out / TABLES_FOLDER, comparison_tables(comparison))
    return comparison


def compare(results: Sequence[ComparedResult]) -> Comparison:
    """Compares results with the first one, settings and numbers."""
    return Comparison(tuple(results), compare_results(results), settings_of(results))


def _result_files(comparison: Comparison, out: Path) -> list[str]:
    names = (SUITE_NAME, JSON_NAME)
    found = [result.folder / name for result in comparison.results for name in names]
    return [
        Path(os.path.relpath(path, out.resolve())).as_posix() for path in found if path.is_file()
    ]


def page_text(comparison: Comparison, files: Sequence[str] = ()) -> str:
    """The page as HTML."""
    sections = sections_of(comparison)
    pictures, missing = pictures_of(comparison.results, _cases(comparison))
    first, *others = comparison.names
    counts = [len(section.names) for section in sections] + [len(one.methods) for one in pictures]
    return render(
        "compare.html.j2",
        "tables",
        "compare",
        title=f"{', '.join(others)} against {first}",
        subtitle=f"{len(comparison.names)} results, compared with {first}.",
        findings=tuple(findings(comparison)),
        settings=_settings_grid(comparison, comparison.differing),
        equal=_settings_grid(comparison, [s for s in comparison.settings if not s.differs]),
        sections=sections,
        pictures=pictures,
        only_in_one=(*(t for pair in comparison.pairs for t in pair.only_in_one), *missing),
        note=_NOTE.format(judged=_titles(_judged(comparison))),
        most=max(counts),
        version=comparison.results[0].versions.get("eventsweep", ""),
        files=files,
    )


def findings(comparison: Comparison) -> Iterator[str]:
    """The settings that differ, the verdict of each result, and whether the data are the same."""
    yield settings_text(comparison)
    for pair in comparison.pairs:
        yield verdict_text(pair)
        yield from pair.data


def settings_text(comparison: Comparison) -> str:
    """What somebody chose differently, or else what else differs, in a sentence."""
    chosen = [one.change() for one in comparison.differing if one.chosen]
    found = chosen or [one.change() for one in comparison.differing]
    if not found:
        return "No setting differs."
    rest = len(comparison.differing) - len(found[:_MOST_SETTINGS])
    more = f"; and {plural(rest, 'other')} below" if rest > 0 else ""
    said = "What differs" if chosen else "No setting differs, but"
    return f"{said}: {'; '.join(found[:_MOST_SETTINGS])}{more}."


def verdict_text(pair: Pair) -> str:
    """How many numbers are better and worse, of what."""
    found = pair.headline
    if not found:
        return f"{pair.other.name} against {pair.first.name}: nothing is judged."
    cases = [one.case for one in found]
    where = " and ".join(dict.fromkeys(cases)) if len(set(cases)) < 3 else "several means"
    metrics = _titles({one.metric for one in found})
    methods = plural(len({one.method for one in found}), "method")
    text = f"{pair.other.name} against {pair.first.name}, {where}: {counts_of(found)}"
    here = _here(found)
    return f"{text}, of {metrics} by {methods}.{here}"


def _judged(comparison: Comparison) -> set[str]:
    return {one.metric for pair in comparison.pairs for one in pair.headline}


def _titles(metrics: Collection[str]) -> str:
    """The titles of judged metrics, or of those that would be judged."""
    return ", ".join(column(name).title for name in JUDGED if name in (metrics or PRIMARY))


def facts_of(comparison: Comparison) -> dict[str, Any]:
    """What differs and every judged or shown number, as plain values for scripts."""
    return {
        "results": [str(result.folder) for result in comparison.results],
        "settings": [
            {"name": one.name, "cases": one.cases, "values": one.texts}
            for one in comparison.differing
        ],
        "pairs": [
            {
                "first": pair.first.name,
                "other": pair.other.name,
                "data": pair.data,
                "not_compared": pair.only_in_one,
                "numbers": [_facts(one) for one in (*pair.means, *pair.cases)],
            }
            for pair in comparison.pairs
        ],
    }


def _facts(one: Difference) -> dict[str, Any]:
    values = {
        name: getattr(one, name) for name in ("first", "other", "change", "low", "high", "p_holm")
    }
    return {
        "case": one.case, "method": one.method, "metric": one.metric, "unit": one.unit,
        **{name: value if math.isfinite(value) else None for name, value in values.items()},
        "seeds": one.seeds, "verdict": one.verdict, "why": one.why,
    }  # fmt: skip


def _here(found: Sequence[Difference]) -> str:
    open_ones = [one for one in found if one.verdict == "undecided" and one.seeds == 1]
    if not open_ones:
        return ""
    directions = [one.tendency for one in open_ones]
    counts = ", ".join(f"{directions.count(one)} {one}" for one in dict.fromkeys(directions))
    return f" With only one seed: {counts}; other seeds may differ."


def _cases(comparison: Comparison) -> list[str]:
    return list(dict.fromkeys(name for pair in comparison.pairs for name in pair.names()))


def _settings_grid(comparison: Comparison, settings: Sequence[Setting]) -> Grid:
    per_case = any(one.cases for one in settings)
    texts = ("setting", *(("of",) if per_case else ()), *comparison.names)
    lines = (
        (
            f"{one.name} [{one.unit}]" if one.unit else one.name,
            *((", ".join(one.cases) or "all cases",) if per_case else ()),
            *one.labelled_texts,
        )
        for one in settings
    )
    cells = tuple(tuple(map(GridCell, line)) for line in lines)
    return Grid(tuple(Head(text, text=True) for text in texts), cells)


def sections_of(comparison: Comparison) -> tuple[Section, ...]:
    """A section over all cases where there are several, then one per case."""
    found: list[tuple[str, list[tuple[Difference, ...]]]] = []
    cases = _cases(comparison)
    means = [pair.means for pair in comparison.pairs]
    if any(means):
        found.append((f"Mean of {plural(len(cases), 'case')}", means))
    for case in cases:
        of_case = [tuple(o for o in pair.cases if o.case == case) for pair in comparison.pairs]
        found.append((case, of_case))
    return tuple(_section(comparison, k, *one) for k, one in enumerate(found))


def _section(
    comparison: Comparison, position: int, title: str, found: Sequence[Sequence[Difference]]
) -> Section:
    present = {one.metric for differences in found for one in differences}
    metrics = [*JUDGED, *(name for name in RANKING_COLUMNS if name not in JUDGED)]
    metrics = [name for name in metrics if name in present]
    grids = tuple(
        _grid(comparison, metric, [[o for o in one if o.metric == metric] for one in found])
        for metric in metrics
    )
    names = tuple(column(metric).title for metric in metrics)
    return Section(f"numbers{position}", title, names, grids)


def _grid(comparison: Comparison, metric: str, found: Sequence[Sequence[Difference]]) -> Grid:
    head = column(metric)
    first, *others = comparison.names
    heads = [Head("method"), Head("result", text=True)] if len(others) > 1 else [Head("method")]
    value = others[0] if len(others) == 1 else "value"
    heads += map(head.head, (first, value))
    heads += [Head(title, head.unit) for title in ("Δ", "Δ from", "Δ to")]
    heads += [Head("Δ", "%"), Head("seeds"), Head("p", "Holm"), Head(VERDICT, text=True)]
    named = [(one, name) for name, of_one in zip(others, found, strict=True) for one in of_one]
    order = _best_first([one for one, _ in named])
    named.sort(key=lambda pair: order.index(pair[0].method))
    lines = tuple(_line(one, name if len(others) > 1 else "") for one, name in named)
    return Grid(tuple(heads), lines, definition(metric))


def _best_first(found: Sequence[Difference]) -> list[str]:
    """The methods by the first result's value; of a metric without a better end, as they come."""
    sign = {"lower": 1.0, "higher": -1.0}.get(found[0].direction if found else "", 0.0)
    ordered = sorted(found, key=lambda o: (math.isnan(o.first), sign and sign * o.first))
    return list(dict.fromkeys(one.method for one in ordered))


def _line(one: Difference, name: str) -> tuple[GridCell, ...]:
    change = one.change if one.verdict != "not comparable" else math.nan
    share = 100 * change / abs(one.first) if one.first else math.nan
    sure = [
        GridCell("–" if math.isnan(value) else signed(value, one.unit), value)
        for value in (change, one.low, one.high)
    ]
    relative = "–" if math.isnan(share) else f"{share:+.1f}".replace("-", "−")
    return (
        GridCell(one.method, colour=line_style(one.method).css),
        *((GridCell(name),) if name else ()),
        GridCell(displayed(one.first, one.unit), one.first),
        GridCell(displayed(one.other, one.unit), one.other),
        *sure,
        GridCell(relative, share),
        GridCell(str(one.seeds) if one.seeds else "–", one.seeds or math.nan),
        GridCell("–" if math.isnan(one.p_holm) else f"{one.p_holm:.3f}", one.p_holm),
        GridCell(one.words, kind=_KINDS.get(one.verdict, "other")),
    )


def comparison_tables(comparison: Comparison) -> dict[str, Grid]:
    """The settings that differ, and one table per case and metric."""
    settings = _settings_grid(comparison, comparison.differing)
    tables = {"settings": _for_file(settings, "Settings that differ")}
    names, cases = {column(name).title: name for name in RANKING_COLUMNS}, _cases(comparison)
    for section in sections_of(comparison):
        stem = section.title if section.title in cases else "mean-of-cases"
        for title, grid in zip(section.names, section.tables, strict=True):
            tables[f"{stem}-{names[title]}"] = _for_file(grid, f"{section.title}: {title}")
    return tables


def _for_file(grid: Grid, caption: str) -> Grid:
    """A table as a file has it: without arrows, under a caption."""
    heads = tuple(replace(head, arrow=False) for head in grid.heads)
    return Grid((replace(heads[0], text=True), *heads[1:]), grid.lines, caption)
