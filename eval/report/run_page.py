"""The report of a run: one page that holds everything and opens without a network."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from eventsweep.emvs.utils.outputs import check_files, files_together
from eventsweep.eval.figures.colormaps import Scale, depth_scale, events_scale
from eventsweep.eval.figures.images import IndexedImage, every_nth
from eventsweep.eval.figures.plots import (
    SharesByName,
    causes_figure,
    curves_figure,
    outlier_causes,
    svg,
)
from eventsweep.eval.numbers import display_unit, displayed, thousands
from eventsweep.eval.report.html import (
    REPORT_NAME,
    Block,
    Choice,
    Details,
    Facts,
    Film,
    Layer,
    Page,
    Picture,
    Pictures,
    Plot,
    Section,
    Sentences,
    Text,
    files_in,
    page_text,
    plural,
    provenance,
)
from eventsweep.eval.report.overview import overview_png
from eventsweep.eval.report.ranking import (
    RANKING_COLUMNS,
    column,
    findings,
    mean_over_cases,
    ranked_methods,
    standings_of,
    table,
)
from eventsweep.eval.report.run_data import CaseData, RunData, WindowData, best_first, load_run
from eventsweep.eval.report.window_page import COLUMNS, events_cap, seconds, window_blocks
from eventsweep.eval.results.table import EVENTS, POOLED, RIG, each
from eventsweep.eval.scoring.curves import THRESHOLDS_CM
from eventsweep.eval.scoring.metrics import NAN
from eventsweep.eval.scoring.run_folder import TRACK_FOLDER
from eventsweep.eval.scoring.standings import RULE, Standing, lead_words

OVERVIEW_NAME = "overview.png"
_SMALL_PX = 480
_READING = (
    "Ordered by {title}. {rule} ● best of its "
    "column; ↓ lower is better, ↑ higher is better. Read errors together with points: a method "
    "that reports fewer pixels has chosen easier ones, so “common” repeats the comparison on the "
    "pixels that all methods report and “equal” at as many points, and the sentences above on "
    "those that two report. “Completeness, any error” is the share of the pixels with "
    "ground truth that have a depth, however wrong; recall, which papers also call completeness, "
    "counts only depth within its stated error. Hold the pointer over a heading for its formula."
)


def write_report(run_dir: Path) -> Path:
    """Writes `report.html` and `overview.png` for a run or map and returns the page's path."""
    run_dir = Path(run_dir)
    check_files(run_dir, (REPORT_NAME, OVERVIEW_NAME), force=True)
    data = load_run(run_dir, for_page=True)
    text = page_text(run_page(data, _files(run_dir, data)))
    first = data.cases[0]
    rows = data.rows_of(first.name, POOLED)
    title = first.name if len(data.cases) > 1 else ""
    overview = overview_png(first, title, ranked_methods(rows, data.ranking_metric))
    with files_together(run_dir, (REPORT_NAME, OVERVIEW_NAME)) as staged:
        (staged / REPORT_NAME).write_text(text, encoding="utf-8")
        (staged / OVERVIEW_NAME).write_bytes(overview)
    return run_dir / REPORT_NAME


def _files(run_dir: Path, data: RunData) -> tuple[str, ...]:
    maps = ["map.json", *(f"{case.name}/map/map.json" for case in data.cases)]
    tracks = [f"{case.name}/{TRACK_FOLDER}/{REPORT_NAME}" for case in data.cases]
    found = files_in(run_dir, ("results.json", "results.csv", "config.toml", *maps, *tracks))
    return (*found, OVERVIEW_NAME)


def run_page(data: RunData, files: Sequence[str] = ()) -> Page:
    """What the page shows; the same data give the same bytes."""
    pooled = data.results.rows[data.results.rows["window"] == POOLED]
    several = len(data.cases) > 1
    overall = mean_over_cases(pooled, "mean") if several else pooled
    windows = sum(case.window_count for case in data.cases)
    names = {method.name for case in data.cases for w in case.windows for method in w.methods}
    counts = plural(windows, "window"), plural(len(names), "method")
    return Page(
        title=", ".join(case.name for case in data.cases),
        subtitle="Depth from events by ray density fusion: "
        f"{', '.join((plural(len(data.cases), 'case'), *counts))}.",
        blocks=(
            *(Text(words, "lead") for words in [_verdict(data)] if words),
            *(block for case in data.cases[:1] for block in _film(data, case)),
        ),
        sections=(
            *_overall(data, overall),
            *(_case(data, case, k) for k, case in enumerate(data.cases)),
            _provenance(data),
        ),
        version=data.results.versions.get("eventsweep", ""),
        files=tuple(files),
    )


def _verdict(data: RunData) -> str:
    """Who is best; where nothing was scored, how much was found; of no map, nothing."""
    rows = data.results.rows[data.results.rows["window"] == POOLED]
    if ranks := standings_of(rows, data.ranking_metric):
        return lead(ranks, rows, data.ranking_metric)
    case = data.cases[0]
    windows = case.film or case.windows
    maps = [window.methods[0] for window in windows if window.methods]
    if not maps:
        return ""
    points, pixels = np.mean([one.mask.sum() for one in maps]), maps[0].mask.size
    each_has = f", on average over {len(maps)} windows" if len(maps) > 1 else ""
    found = f"{thousands(points)} px ({100 * points / pixels:.1f} % of the image){each_has}"
    return f"{maps[0].name} found depth at {found}; not scored."


def columns_by(metric: str) -> tuple[str, ...]:
    """Points, and what orders the table, come first: a phone shows few columns more."""
    first = ("points", metric)
    return (*first, *(name for name in RANKING_COLUMNS if name not in first))


def lead(ranks: Sequence[Standing], rows: pd.DataFrame, metric: str, seeds: int = 1) -> str:
    """A page's verdict: who is first; with one seed, which ranks nobody, by how much."""
    if seeds > 1:
        return lead_words(ranks, seeds)
    title, unit = column(metric).title, rows.loc[rows["metric"] == metric, "unit"].iloc[0]
    first = [one for one in ranks if one.place == ranks[0].place]
    values = [f"{displayed(r.values[0], unit)} {display_unit(unit)}".rstrip() for r in ranks]
    names, are = ", ".join(one.method for one in first), "are" if len(first) > 1 else "is"
    if len(ranks[0].values) > 1:
        verdict = f"{names} {are} placed first by {title} over {len(ranks[0].values)} cases."
    elif math.isnan(ranks[0].values[0]):
        return f"No method has a {title}: none has a depth that could be scored."
    elif len(ranks) == 1:
        return f"{names}: {title} {values[0]}, from one seed."
    else:
        behind = [f", then {r.method} with {v}" for r, v in zip(ranks, values, strict=True)]
        verdict = f"{names} {are} best: {title} {values[0]}{''.join(behind[len(first) :][:1])}."
    return f"{verdict} One seed does not show whether that holds for others."


def _overall(data: RunData, rows: pd.DataFrame) -> Iterator[Section]:
    """The ranking over all cases; nothing where nothing was scored."""
    if not len(rows):
        return
    count, metric = len(data.cases), data.ranking_metric
    title = column(metric).title
    yield Section(
        "ranking",
        f"Ranking, mean of {count} cases" if count > 1 else "Ranking",
        (
            Sentences(tuple(findings(rows, metric, count))),
            table(rows, metric, columns_by(metric)).grid(),
            Text(_READING.format(title=title, rule=RULE.format(title=title)), "note"),
        ),
    )


def _case(data: RunData, case: CaseData, position: int) -> Section:
    rows, metric = data.rows_of(case.name, POOLED), data.ranking_metric
    summary = case.summary[:1].upper() + case.summary[1:].removesuffix(".")
    blocks: list[Block] = [Text(f"{summary}.")] if summary else []
    blocks.append(Facts(case.facts))
    if position:
        blocks += _film(data, case)
    if len(data.cases) > 1 and len(rows):
        blocks += [
            Sentences(tuple(findings(rows, metric))),
            table(rows, metric, columns_by(metric)).grid(),
        ]
    methods = _methods(data, case)
    shown = (*_windows(data, case, methods), *_plots(rows, methods, f"case{position}"))
    blocks.append(Choice(f"case{position}", "Method", tuple(methods), shown))
    if len(rows):
        measured = rows.loc[~rows["method"].isin((RIG, EVENTS)), "metric"].unique()
        of_curves = ("precision", "recall", "f1")
        every = table(rows, metric, [n for n in measured if not n.startswith(of_curves)])
        blocks.append(Details("Every metric", (every.by_metric(),)))
    return Section(f"case{position}", case.name, tuple(blocks))


def _methods(data: RunData, case: CaseData) -> list[str]:
    """Those that have a map, the best first."""
    drawn = dict.fromkeys(method.name for window in case.windows for method in window.methods)
    return best_first(data.rows_of(case.name, POOLED), data.ranking_metric, drawn)


def _windows(data: RunData, case: CaseData, methods: Sequence[str]) -> Iterator[Block]:
    count = len(case.windows)
    if count < case.window_count:
        scored = "; all are scored" * bool(len(data.rows_of(case.name, POOLED)))
        yield Text(f"{count} of {case.window_count} windows are shown{scored}.", "note")
    for k, window in enumerate(case.windows):
        blocks = window_blocks(window, methods, data.rows_of(case.name, window.name))
        time = seconds(window.t_us - case.clock_us)
        if count > 1:
            title = f"Window {window.name}, reference view at {time}"
            yield Details(title, blocks, is_open=k == 0)
        else:
            yield from blocks


def _plots(rows: pd.DataFrame, methods: Sequence[str], prefix: str) -> Iterator[Block]:
    """Curves and causes of all methods; nothing where nothing was scored."""
    scored = with_predictions(methods, rows)
    if curves := curves_of(rows, scored):
        yield Text("Precision, recall and F1", "heading")
        yield Text(
            "Of the estimates (precision) and of the ground truth (recall), the share that is "
            "right to within a tolerated error. The chosen method is drawn thick.",
            "note",
        )
        yield Plot(svg(curves_figure, curves, prefix), "precision, recall and F1 per method")
    if causes := outlier_causes(rows, scored):
        yield Text("Why outliers are outliers", "heading")
        yield Text(
            "Each point with an error above 10 % of the true depth has one cause: the first that "
            "applies, from left to right.",
            "note",
        )
        yield Plot(svg(causes_figure, causes), "outliers by cause, per method")


def with_predictions(mapped: Sequence[str], rows: pd.DataFrame) -> list[str]:
    """The methods that there are depth maps of, and behind them others that were scored."""
    return list(dict.fromkeys([*mapped, *rows.loc[rows["metric"] == "points", "method"]]))


def curves_of(rows: pd.DataFrame, methods: Sequence[str]) -> list[tuple[str, SharesByName]]:
    """The curves of all methods, from the rows of one case; none where nothing was scored."""
    values = {(row.method, row.metric): row.value for row in each(rows)}
    if not any((method, "points") in values for method in methods):
        return []
    return [
        (method, {
            name: np.array([values.get((method, f"{name}_{cm}cm"), NAN) for cm in THRESHOLDS_CM])
            for name in ("precision", "recall", "f1")
        })
        for method in methods
    ]  # fmt: skip


def _film(data: RunData, case: CaseData) -> Iterator[Film]:
    """The best method's depth in many windows, in small pictures.

    Of a case without a film, that is one of its windows.
    """
    best = _methods(data, case)[:1]
    shown = (
        case.film
        or [
            replace(window, methods=(method,))
            for window in case.windows
            for method in window.methods
            if method.name in best
        ][:1]
    )
    if shown:
        whole = next((w for w in case.windows if w.name == shown[0].name), shown[0])
        scale = depth_scale(whole.shown_range_m)  # as where all of its methods are drawn
        yield Film(tuple(
            (f"{w.name}, {seconds(w.t_us - case.clock_us)}",
             Pictures(tuple(_still(w, scale)), COLUMNS))
            for w in shown
        ))  # fmt: skip


def _still(window: WindowData, scale: Scale) -> Iterator[Picture]:
    method = window.methods[0]
    layer = Layer(_small_uri(method.depth_image(scale)), method.name)
    yield Picture("Depth [m]", (layer,), scale)
    seen = window.images(scale, events_scale(events_cap(window)))
    for name in ("Frame", "Events"):
        if name in seen:
            yield Picture(name, (Layer(_small_uri(seen[name]), "camera 0"),))


def _small_uri(image: IndexedImage) -> str:
    """A picture of at most some 500 columns: every n-th row and column of a larger one."""
    return every_nth(image, -(-image.index.shape[1] // _SMALL_PX)).data_uri()


def _provenance(data: RunData) -> Section:
    results = data.results
    library_texts = (f"{name} {version}" for name, version in results.versions.items())
    facts = [("versions", ", ".join(library_texts)), ("platform", results.platform)]
    if results.seed is not None:
        facts.insert(0, ("seed", str(results.seed)))
    facts += [(f"sha256 of {name}", digest) for name, digest in results.sequences.items()]
    rows = each(results.rows[results.rows["metric"] == "baseline_focal"])
    units = {row.case: f"{row.value:.4g} {row.unit}" for row in rows}
    facts += [(f"baseline × focal length of {case}", text) for case, text in units.items()]
    stated = (
        [Details("Configuration", (Text(data.configuration, "file"),))]
        if data.configuration
        else []
    )
    return provenance(Facts(tuple(facts)), *stated)
