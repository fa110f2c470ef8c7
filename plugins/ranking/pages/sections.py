"""What the page of a ranking shows, section by section."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from eventsweep.emvs.methods import named
from eventsweep.emvs.methods.method import Method
from eventsweep.eval.figures.plots import causes_figure, svg
from eventsweep.eval.report.html import (
    Grid,
    GridCell,
    Head,
    Picture,
    Plot,
    Section,
    Sentences,
    Text,
    grid,
    plural,
    tables,
    versions_grid,
)
from eventsweep.eval.report.ranking import column, definition, named_cell, value_cell
from eventsweep.eval.results.direction import Direction, best
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.scoring.standings import Standing, lead_words
from eventsweep.plugins.ranking import summary
from eventsweep.plugins.ranking.entries import (
    COVERAGES,
    POSE_METRICS,
    Merged,
    RankingEntry,
    finite_mean,
)
from eventsweep.plugins.ranking.figure import cost_figure, coverage_figure, history_figure
from eventsweep.plugins.ranking.summary import CONDITIONS, MAIN, OTHERS, Ranked
from eventsweep.plugins.ranking.tracks import OTHERS as TRACKS

_RELATIVE = "× median method"
_NAMED = 4  # a track with more cases gives their number instead of their names


@dataclass(frozen=True)
class RankingPage:
    """What a page is made of; entries are oldest first, and ranks are by the main metric.

    `pages` are addresses of pages of single methods, `tracks` the rankings of other tracks.
    """

    entries: tuple[RankingEntry, ...]
    public: Ranked
    hidden: Ranked | None
    pictures: Mapping[str, tuple[Picture, ...]]
    pages: Mapping[str, str] = field(default_factory=dict)
    tracks: Mapping[str, Ranked] = field(default_factory=dict)

    @property
    def joined(self) -> Merged:
        """The public part."""
        return self.public.joined

    @property
    def methods(self) -> list[str]:
        """Those that have a rank, the first one first."""
        return [standing.method for standing in self.public.standings]


def _rank(one: Standing | None) -> GridCell:
    return GridCell("–") if one is None else GridCell(str(one.rank), one.rank)


def _number(value: float, digits: int = 2, *, is_best: bool = False) -> GridCell:
    text = "–" if math.isnan(value) else f"{value:,.{digits}f}"
    return GridCell(text, value, "best" if is_best else "")


def data(entry: RankingEntry) -> str:
    """Which sequences an entry is of."""
    return f"archive {entry.archive.version}" if entry.archive else "drawn anew, not archived"


def overview(page: RankingPage) -> Grid:
    """Ranks with ties, error, coverage and cost: a line for each method."""
    joined, hidden = page.joined, page.hidden
    heads = [
        "method", Head("rank"), Head("mean place"),
        Head("relative error", "%", arrow=True), Head("coverage", "%", "higher", arrow=True),
        Head("outliers", "%", arrow=True),
    ]  # fmt: skip
    if hidden:
        heads += [Head("rank, hidden part"), Head("error, hidden part", "%", arrow=True)]
    heads += [Head("time", "s per window"), Head("memory", "MB"), "note"]
    errors = [summary.geometric(joined, m, "abs_rel", joined.cases) for m in page.methods]
    best_error = best(errors, "lower")
    lines = []
    for standing, error in zip(page.public.standings, errors, strict=True):
        coverage = summary.arithmetic(joined, standing.method, "completeness", joined.cases)
        outliers = summary.arithmetic(joined, standing.method, "outlier_share", joined.cases)
        named = replace(named_cell(standing.method), link=page.pages.get(standing.method, ""))
        cells = [
            named, _rank(standing), _number(standing.place, 2),
            _number(error, is_best=error == best_error), _number(coverage),
            _number(outliers),
        ]  # fmt: skip
        if hidden:
            there = hidden.by_method.get(standing.method)
            cells += [_rank(there), _number(_hidden_error(hidden, standing.method))]
        lines.append((*cells, *_cost_cells(joined, standing.method), _note(page, standing.method)))
    return grid(heads, lines)


def _hidden_error(hidden: Ranked, method: str) -> float:
    if method not in hidden.by_method:
        return math.nan
    return summary.geometric(hidden.joined, method, "abs_rel", hidden.joined.cases)


def _cost_cells(joined: Merged, method: str) -> tuple[GridCell, GridCell]:
    """Time and memory: measured here, else as stated, which is marked."""
    entry = joined.owner[method]
    if method in entry.cost:
        one = entry.cost[method]
        return GridCell(f"{one.cpu_seconds:.3g}", one.cpu_seconds), GridCell(
            f"{one.peak_memory_mb:,.0f}", one.peak_memory_mb
        )
    if method not in entry.stated:
        return GridCell("–"), GridCell("–")
    cost = entry.stated[method].cost
    return (
        GridCell(f"{cost.seconds_per_window:.3g} stated", cost.seconds_per_window, "other"),
        GridCell(f"{cost.peak_memory_mb:,.0f} stated", cost.peak_memory_mb, "other"),
    )


def _note(page: RankingPage, method: str) -> GridCell:
    where = [
        place
        for ranked in (page.public, page.hidden)
        if ranked and method in ranked.joined.owner
        for place in ranked.joined.owner[method].perfect.get(method, ())
    ]
    if where:
        return GridCell(f"perfect in {plural(len(where), 'sequence')}: copied truth?", kind="worse")
    stated = page.joined.owner[method].stated.get(method)
    if stated is not None:
        return GridCell(f"by {', '.join(stated.authors)}")
    known = named(method)
    trained = isinstance(known, Method) and known.extraction.trained
    return GridCell("trained on other motions of these scenes" if trained else "")


def _standing_grid(ranked: Ranked, about: str) -> Grid:
    head = column(ranked.metric)
    heads = (
        "method", Head("rank"), Head("mean place"),
        head.head(f"{head.title}, mean of cases"),
    )  # fmt: skip
    unit = ranked.joined.base.units[ranked.metric][0]
    means = {
        standing.method: sum(standing.values) / len(standing.values)
        if standing.values
        else math.nan
        for standing in ranked.standings
    }
    best_mean = best(means.values(), head.direction)
    lines = tuple(
        (
            named_cell(standing.method), _rank(standing), _number(standing.place),
            value_cell(means[standing.method], unit, best_mean),
        )
        for standing in ranked.standings
    )  # fmt: skip
    return grid(heads, lines, about)


def hidden(page: RankingPage) -> Iterator[Section]:
    """Ranks on the hidden part; nothing where there is none."""
    if page.hidden is None:
        return
    base = page.hidden.joined.base
    assert base.archive is not None  # that is how it is known to be hidden
    text = (
        "Motions and noise that no public archive holds: "
        f"{plural(len(page.hidden.joined.cases), 'case')} with {plural(len(base.seeds), 'seed')} "
        f"each, archive {base.archive.version}, from a secret whose SHA-256 is "
        f"{base.archive.secret_sha256}."
    )
    ranks = _standing_grid(page.hidden, definition(MAIN))
    yield Section("hidden", "Hidden part", (Text(text), ranks))


def ranks(page: RankingPage) -> Section:
    """Ranks by each metric."""
    known = [metric for metric in OTHERS if metric in page.joined.base.units]
    ranked = [summary.ranked(page.joined, metric) for metric in known]
    titles = [column(metric).title for metric in known]
    grids = [_standing_grid(one, definition(one.metric)) for one in ranked]
    return Section("ranks", "Ranks by other metrics", tables("ranks", titles, grids))


def track(name: str, found: Ranked) -> Section:
    """A track beside the suite's: who is ahead, and a line for each method."""
    its, joined = TRACKS[name], found.joined
    metrics = [metric for metric in its.metrics if metric in joined.base.units]
    heads = [column(metric) for metric in metrics]
    values = {
        (one.method, metric): summary.arithmetic(joined, one.method, metric, joined.cases)
        for one in found.standings
        for metric in metrics
    }
    tops = {h.name: best((values[m.method, h.name] for m in found.standings), h.direction)
            for h in heads}  # fmt: skip
    lines = [
        (named_cell(one.method), _rank(one), _number(one.place),
         *(value_cell(values[one.method, h.name], joined.base.units[h.name][0], tops[h.name])
           for h in heads))
        for one in found.standings
    ]  # fmt: skip
    seeds = plural(len(joined.base.seeds), "seed")
    count = len(joined.cases)
    cases = ", ".join(joined.cases) if count <= _NAMED else plural(count, "case")
    where = f"{cases}; {seeds}. Means over cases; ranks are by the first metric."
    refused = tuple(f"{label}: {why}." for label, why in joined.refused)
    blocks = (
        Text(lead_words(found.standings, len(joined.base.seeds)), "lead"),
        Text(f"{its.about} {where}"),
        Sentences(refused),
        grid(("method", Head("rank"), Head("mean place"), *(h.head() for h in heads)), lines),
    )
    return Section(name, its.title, blocks)


def coverage(page: RankingPage) -> Section:
    """Error over coverage."""
    joined = page.joined
    curves = {m: summary.coverage_curve(joined, m, page.methods) for m in page.methods}
    reached = {x for curve in curves.values() for x, _ in curve[:-1]}
    shown = [share for share in COVERAGES if share in reached]
    heads = (
        "method",
        Head("coverage", "%", "higher", arrow=True),
        Head("error on all its pixels", _RELATIVE, arrow=True),
        *(Head(f"surest {share} %", _RELATIVE, arrow=True) for share in shown),
    )
    lines = []
    for method, curve in curves.items():
        known = dict(curve[:-1])
        last = curve[-1] if curve else (math.nan, math.nan)
        cells = (_number(known.get(float(share), math.nan)) for share in shown)
        lines.append((named_cell(method), _number(last[0]), _number(last[1]), *cells))
    text = Text(
        "A method that reports few pixels can choose easy ones. Each curve shows the error over "
        "the most confident pixels, as a share of all true pixels, relative in each case to the "
        "median method's error on all its pixels; a point is drawn where half of the cases have "
        "that many. Methods without a confidence have one point."
    )
    plot = Plot(svg(coverage_figure, curves), "error over coverage, a curve per method")
    return Section("coverage", "Error over coverage", (text, plot, grid(heads, lines)))


def conditions(page: RankingPage) -> Section:
    """Places, error and coverage under each condition."""
    joined = page.joined
    cases = {condition: summary.cases_of(joined, condition) for condition in CONDITIONS}
    plain = tuple(c for c in joined.cases if not joined.base.cases[c].conditions)
    groups = {**{name: case for name, case in cases.items() if case}, "none of these": plain}
    groups = {name: group for name, group in groups.items() if group}
    heads = {name: plural(len(group), "case") for name, group in groups.items()}
    values = {
        "mean place": {
            name: summary.mean_places(joined, page.methods, group) for name, group in groups.items()
        },
        "relative error [%]": {
            name: {m: summary.geometric(joined, m, "abs_rel", group) for m in page.methods}
            for name, group in groups.items()
        },
        "coverage [%]": {
            name: {m: summary.arithmetic(joined, m, "completeness", group) for m in page.methods}
            for name, group in groups.items()
        },
    }
    about = Text("; ".join(f"{name}: {', '.join(group)}" for name, group in groups.items()) + ".")
    grids = [_by_column(page, heads, columns, title) for title, columns in values.items()]
    choice = tables("conditions", list(values), grids, "Shows")
    return Section("conditions", "Conditions", (about, *choice))


def _by_column(
    page: RankingPage,
    heads: Mapping[str, str],
    columns: Mapping[str, Mapping[str, float]],
    title: str,
) -> Grid:
    direction: Direction = "higher" if title.startswith("coverage") else "lower"
    tops = {name: best(found.values(), direction) for name, found in columns.items()}
    lines = tuple(
        (
            named_cell(method),
            *(_number(found[method], is_best=found[method] == tops[name])
              for name, found in columns.items()),
        )
        for method in page.methods
    )  # fmt: skip
    arrows = (Head(name, count, direction, arrow=True) for name, count in heads.items())
    return grid(("method", *arrows), lines)


def scenes(page: RankingPage) -> Section:
    """Numbers of every case."""
    joined = page.joined
    cases = [case for case in joined.base.cases if joined.seeds[case]]
    metrics = [
        m for m in ("abs_rel", MAIN, "completeness", "outlier_share") if m in joined.base.units
    ]
    others = [m for m in joined.owner if m not in page.methods]
    grids = tuple(_scene_grid(joined, [*page.methods, *others], cases, m) for m in metrics)
    titles = [column(metric).title for metric in metrics]
    text = Text("Means over the seeds; the best of each case is marked.")
    return Section("scenes", "Scenes", (text, *tables("scenes", titles, grids)))


def _scene_grid(joined: Merged, methods: Sequence[str], cases: Sequence[str], metric: str) -> Grid:
    head, unit = column(metric), joined.base.units[metric][0]
    heads = ("method", *map(head.head, cases))
    values = {
        (method, case): finite_mean(joined.of_case(method, metric, case))
        for method in methods
        for case in cases
    }
    tops = {case: best((values[m, case] for m in methods), head.direction) for case in cases}
    lines = []
    for method in methods:
        found = [(values[method, case], tops[case]) for case in cases]
        if any(math.isfinite(value) for value, _ in found):
            lines.append(
                (named_cell(method), *(value_cell(value, unit, top) for value, top in found))
            )
    return grid(heads, lines, definition(metric))


def poses(page: RankingPage) -> Iterator[Section]:
    """How well poses were found from events, case by case; nothing where none were."""
    base = page.joined.base
    metrics = [m for m in POSE_METRICS if any(m in pose for pose in base.poses.values())]
    if not metrics:
        return
    heads = ("case", *(column(m).head() for m in metrics))
    grids = [grid(heads, _pose_lines(base, pose, metrics)) for pose in base.poses.values()]
    text = "Means over the seeds; where one had no poses, only the time covered has one."
    choice = tables("poses", list(base.poses), grids)
    yield Section("poses", "Poses from events", (Text(text), *choice))


def _pose_lines(
    base: RankingEntry, found: Mapping[str, Mapping[str, Sequence[float]]], metrics: Sequence[str]
) -> tuple[tuple[object, ...], ...]:
    cases = dict.fromkeys(case for metric in metrics for case in found.get(metric, {}))
    return tuple(
        (
            case,
            *(
                value_cell(finite_mean(found.get(m, {}).get(case, ())), base.units[m][0], math.nan)
                for m in metrics
            ),
        )
        for case in cases
    )


def cost(page: RankingPage) -> Section:
    """Error against cost, measured beside stated."""
    joined = page.joined
    heads = (
        "method", Head("measured here: time", "CPU s per window"),
        Head("memory", "MB"), Head("stated: time", "s per window"), Head("stated: memory", "MB"),
        "stated: hardware", Head("relative error", "%", arrow=True),
    )  # fmt: skip
    lines, points = [], {}
    for method in page.methods:
        entry = joined.owner[method]
        ours, stated = entry.cost.get(method), entry.stated.get(method)
        error = summary.geometric(joined, method, "abs_rel", joined.cases)
        theirs_s = stated.cost.seconds_per_window if stated else math.nan
        theirs_mb = stated.cost.peak_memory_mb if stated else math.nan
        ours_s = ours.cpu_seconds if ours else math.nan
        lines.append((
            named_cell(method), _number(ours_s, 3),
            _number(ours.peak_memory_mb if ours else math.nan, 0), _number(theirs_s, 3),
            _number(theirs_mb, 0), stated.cost.hardware if stated else "",
            _number(error),
        ))  # fmt: skip
        seconds = theirs_s if math.isnan(ours_s) else ours_s
        if math.isfinite(seconds) and math.isfinite(error):
            points[method] = seconds, error, math.isnan(ours_s)
    cases = {c.case for m in page.methods for c in [joined.owner[m].cost.get(m)] if c}
    where = f" of {', '.join(sorted(cases))}, on {joined.base.platform}" if cases else ""
    text = Text(
        f"Measured: the first window{where}, each method alone in one thread, the whole "
        "process's memory. Stated: as reported by submitters, not checked."
    )
    about = "relative error against time for a window"
    plots = (Plot(svg(cost_figure, points), about),) if points else ()
    return Section("cost", "Accuracy against cost", (text, *plots, grid(heads, lines)))


def causes(page: RankingPage) -> Iterator[Section]:
    """Why outliers are outliers; nothing where that is not known."""
    found = {m: summary.causes(page.joined, m) for m in page.methods}
    shares = {method: one for method, one in found.items() if one is not None}
    if not shares:
        return
    heads = (
        "method", Head("outliers", "% of its points", arrow=True),
        *(Head(cause.replace("_", " "), "% of these") for cause in CAUSES),
    )  # fmt: skip
    lines = tuple(
        (named_cell(m), _number(share), *(_number(parts[cause], 1) for cause in CAUSES))
        for m, (share, parts) in shares.items()
    )
    text = Text(
        "Points whose error is above a tenth of the true depth, by their most likely cause; all "
        "points of all cases together."
    )
    plot = Plot(svg(causes_figure, shares), "outliers by cause")
    yield Section("causes", "Why points are wrong", (text, plot, grid(heads, lines)))


def history(page: RankingPage) -> Iterator[Section]:
    """Errors over versions; nothing of a single one."""
    public = [entry for entry in page.entries if entry.part == "public"]
    found = summary.history(public, page.joined)
    if not found.lines:
        return
    heads = ("method", *(Head(label, "%", arrow=True) for label in found.labels))
    lines = tuple((named_cell(method), *map(_number, line)) for method, line in found.lines.items())
    text = "Relative error with each version of the code, on the same sequences, oldest first."
    plot = Plot(svg(history_figure, found.labels, found.lines), "relative error over versions")
    yield Section("history", "History", (Text(text), plot, grid(heads, lines)))


def made(page: RankingPage) -> Grid:
    """What made each result."""
    entries = page.entries
    made_by = versions_grid(
        [entry.label for entry in entries], [entry.versions for entry in entries]
    )
    stages = sorted({stage for entry in entries for stage in entry.code})
    facts: dict[str, list[str]] = {
        "suite": [f"{entry.suite} ({entry.digest})" for entry in entries],
        "part": [entry.part for entry in entries],
        "sequences": [data(entry) for entry in entries],
        "seeds": [
            plural(len(entry.seeds), "seed")
            if entry.part == "hidden"
            else ", ".join(map(str, entry.seeds))
            for entry in entries
        ],
        "platform": [entry.platform for entry in entries],
        **{
            f"code of {stage}": [entry.code.get(stage, "") for entry in entries] for stage in stages
        },
    }
    more = ((name, *texts) for name, texts in facts.items())
    return grid(made_by.heads, (*more, *made_by.lines))
