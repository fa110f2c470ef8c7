"""The page of results side by side: the verdict, numbers with how sure they are, settings."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from eventsweep.emvs.utils.outputs import files_together, output_folder
from eventsweep.eval.numbers import displayed
from eventsweep.eval.report.compare.differences import (
    JUDGED,
    Difference,
    Pair,
    compare_results,
    counts_of,
    shift_of,
    signed,
)
from eventsweep.eval.report.compare.pictures import picture_sections
from eventsweep.eval.report.compare.results import ComparedResult, read_compared
from eventsweep.eval.report.compare.settings import Setting, settings_of
from eventsweep.eval.report.html import (
    Details,
    Grid,
    GridCell,
    Head,
    Kind,
    Page,
    Section,
    Sentences,
    Text,
    grid,
    page_text,
    plural,
    tables,
)
from eventsweep.eval.report.ranking import RANKING_COLUMNS, column, definition, named_cell
from eventsweep.eval.report.tables import TABLES_FOLDER, write_tables
from eventsweep.eval.results.results import JSON_NAME, SUITE_NAME
from eventsweep.eval.scoring.metrics import PRIMARY

HTML_NAME = "compare.html"
VERDICT = "verdict"
_MOST_SETTINGS = 5
_KINDS: Mapping[str, Kind] = {"better": "better", "worse": "worse", "equal": ""}
_NOTE = (
    "The change in the first line is the median over the methods of Δ %, ± half of the 95 % "
    "interval of that median over seeds. "
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
        return tuple(setting for setting in self.settings if setting.differs)

    @property
    def names(self) -> tuple[str, ...]:
        """What the results are called."""
        return tuple(result.name for result in self.results)


def write_comparison(paths: Sequence[Path], out: Path) -> Comparison:
    """Writes `compare.html` and `tables/` into a folder, and returns what they say."""
    with output_folder(out, (HTML_NAME, TABLES_FOLDER), force=True):
        comparison = compare(read_compared(paths))
        text = page_text(comparison_page(comparison, _result_files(comparison, out)))
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


def comparison_page(comparison: Comparison, files: Sequence[str] = ()) -> Page:
    """What the page shows: the verdicts first, the settings last."""
    pictures, missing = picture_sections(comparison.results, _cases(comparison))
    first, *others = comparison.names
    apart = *(line for pair in comparison.pairs for line in pair.only_in_one), *missing
    numbers = [
        Section(name, title, tables(name, list(map(_title, grids)), shown))
        for k, (title, grids) in enumerate(number_grids(comparison).items())
        for name, shown in [(f"numbers{k}", list(map(_verdict_first, grids.values())))]
    ]
    note = Text(_NOTE.format(judged=_titles(_judged(comparison))), "note")
    numbers[-1] = replace(numbers[-1], blocks=(*numbers[-1].blocks, note))
    return Page(
        title=f"{', '.join(others)} against {first}",
        subtitle=f"{len(comparison.names)} results, compared with {first}.",
        blocks=(
            *(Text(lead_text(pair), "lead") for pair in comparison.pairs),
            Sentences(tuple(findings(comparison))),
        ),
        sections=(
            *numbers,
            *pictures,
            *((Section("apart", "Not compared", (Sentences(apart),)),) if apart else ()),
            _settings_section(comparison),
        ),
        version=comparison.results[0].versions.get("eventsweep", ""),
        files=tuple(files),
    )


def _settings_section(comparison: Comparison) -> Section:
    differing = comparison.differing
    equal = [setting for setting in comparison.settings if not setting.differs]
    none = "None: whatever differs comes from the data or from what is not a setting."
    shown = _settings_grid(comparison, differing) if differing else Text(none)
    folded = Details(f"{len(equal)} are equal", (_settings_grid(comparison, equal),))
    return Section("settings", "Settings that differ", (shown, folded))


def findings(comparison: Comparison) -> Iterator[str]:
    """The verdict of each result, whether the data are the same, and what was set otherwise."""
    for pair in comparison.pairs:
        yield verdict_text(pair)
        yield from pair.data
    yield settings_text(comparison)


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


def lead_text(pair: Pair) -> str:
    """Which result is better, and by how much in the middle of the methods, in one sentence."""
    said, shift = f"{pair.other.name} {_outcome(pair)}", shift_of(pair)
    if shift is None or {one.verdict for one in pair.headline} == {"equal"}:
        return f"{said}."
    change = f"{shift.median:+.1f} %".replace("-", "−")
    alone = math.isnan(shift.half)
    half = "" if alone else f" ± {shift.half:.1f}"
    about = [f"median of {shift.methods} methods"] if shift.methods > 1 else []
    about += ["no interval"] if alone else []
    said += f": {column(shift.metric).title} {change}{half}"
    return f"{said} ({', '.join(about)})." if about else f"{said}."


def _outcome(pair: Pair) -> str:
    """What the verdicts come to; better or worse only where none says the opposite."""
    verdicts, first = [one.verdict for one in pair.headline], pair.first.name
    better, worse = verdicts.count("better"), verdicts.count("worse")
    if better and worse:
        return f"is better than {first} in {plural(better, 'number')} and worse in {worse}"
    if better or worse:
        return f"is {'better' if better else 'worse'} than {first}"
    if set(verdicts) == {"equal"}:
        return f"equals {first} in every number that is judged"
    if set(verdicts) <= {"not comparable"}:
        return f"cannot be compared with {first}"
    if "no difference shown" in verdicts:
        return f"shows no difference to {first}"
    seeds = {one.seeds for one in pair.headline}
    return f"against {first}: undecided, {'one seed' if max(seeds) == 1 else 'no seed in common'}"


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
    directions = [open_one.tendency for open_one in open_ones]
    counts = ", ".join(
        f"{directions.count(direction)} {direction}" for direction in dict.fromkeys(directions)
    )
    return f" With only one seed: {counts}; other seeds may differ."


def _cases(comparison: Comparison) -> list[str]:
    return list(dict.fromkeys(name for pair in comparison.pairs for name in pair.names()))


def _settings_grid(comparison: Comparison, settings: Sequence[Setting]) -> Grid:
    per_case = any(setting.cases for setting in settings)
    texts = ("setting", *(("of",) if per_case else ()), *comparison.names)
    lines = (
        (
            f"{setting.name} [{setting.unit}]" if setting.unit else setting.name,
            *((", ".join(setting.cases) or "all cases",) if per_case else ()),
            *setting.labelled_texts,
        )
        for setting in settings
    )
    return grid(texts, lines)


def number_grids(comparison: Comparison) -> dict[str, dict[str, Grid]]:
    """Tables by metric: over all cases where there are several, then of each case."""
    cases = _cases(comparison)
    numbers = {case: [_of_case(pair, case) for pair in comparison.pairs] for case in cases}
    means = [pair.means for pair in comparison.pairs]
    if any(means):
        numbers = {f"Mean of {plural(len(cases), 'case')}": means, **numbers}
    return {
        title: {
            metric: _grid(comparison, metric, of_metric)
            for metric in dict.fromkeys((*JUDGED, *RANKING_COLUMNS))
            if any(of_metric := [[d for d in ds if d.metric == metric] for ds in differences])
        }
        for title, differences in numbers.items()
    }


def _of_case(pair: Pair, case: str) -> tuple[Difference, ...]:
    return tuple(difference for difference in pair.cases if difference.case == case)


def _title(metric: str) -> str:
    return column(metric).title


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


def _verdict_first(table: Grid) -> Grid:
    """The verdict and the relative change beside the names: what a narrow screen shows."""
    names = sum(head.title in ("method", "result") for head in table.heads[:2])
    last = len(table.heads) - 1
    share = next(k for k, head in enumerate(table.heads) if (head.title, head.unit) == ("Δ", "%"))
    first = (*range(names), last, share)
    order = (*first, *(k for k in range(last) if k not in first))
    lines = tuple(tuple(line[k] for k in order) for line in table.lines)
    return replace(table, heads=tuple(table.heads[k] for k in order), lines=lines)


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
        named_cell(one.method),
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
    files, cases = {"settings": _for_file(settings, "Settings that differ")}, _cases(comparison)
    for title, grids in number_grids(comparison).items():
        stem = title if title in cases else "mean-of-cases"
        for metric, table in grids.items():
            files[f"{stem}-{metric}"] = _for_file(table, f"{title}: {_title(metric)}")
    return files


def _for_file(table: Grid, caption: str) -> Grid:
    """A table as a file has it: without arrows, under a caption."""
    heads = tuple(replace(head, arrow=False) for head in table.heads)
    return Grid((replace(heads[0], text=True), *heads[1:]), table.lines, caption)
