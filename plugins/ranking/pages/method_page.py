"""A method's own page of a ranking: where it is good, what it looks like, who made it and how."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from zlib import crc32

from eventsweep.eval.report.html import (
    Grid,
    Head,
    Page,
    Pictures,
    Section,
    Text,
    grid,
    plural,
    provenance,
)
from eventsweep.eval.report.ranking import column, value_cell
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.plugins.ranking import summary
from eventsweep.plugins.ranking.entries import RANKED_BY, RankingEntry, finite_mean
from eventsweep.plugins.ranking.pages.sections import RankingPage, data
from eventsweep.plugins.ranking.summary import CONDITIONS, OTHERS

FOLDER = "methods"
_SHOWN = ("abs_rel", RANKED_BY, "median_error", "completeness", "outlier_share")


def page_names(methods: Sequence[str]) -> dict[str, str]:
    """Per method, the name of its page: of letters, digits, dots and lines alone, none twice."""
    plain = {method: re.sub(r"[^A-Za-z0-9.-]+", "_", method)[:80] for method in methods}
    counts = {name.lower(): 0 for name in plain.values()}
    for name in plain.values():
        counts[name.lower()] += 1
    return {
        method: f"{name}.html"
        if counts[name.lower()] == 1
        else f"{name}-{crc32(method.encode()):08x}.html"
        for method, name in plain.items()
    }


def method_page(page: RankingPage, method: str, links: Sequence[tuple[str, str]]) -> Page:
    """What the page of a ranked method shows."""
    joined = page.joined
    entry, standing = joined.owner[method], page.public.by_method[method]
    equal = [one.method for one in page.public.standings if one.rank == standing.rank]
    equal.remove(method)
    shared = f", equal with {', '.join(equal)}" if equal else ""
    error = summary.geometric(joined, method, "abs_rel", joined.cases)
    said = f"{shared}: relative error {error:.2f} %."
    return Page(
        title=method,
        subtitle=f"{joined.base.suite}: {plural(len(joined.cases), 'case')}, "
        f"{plural(len(joined.base.seeds), 'seed')} each; sequences: {data(entry)}.",
        blocks=(
            Text(f"Rank {standing.rank} of {len(page.methods)}{said}", "lead"),
            Pictures(page.pictures.get(method, ())),
            _ranks(page, method),
        ),
        sections=(
            _conditions(page, method),
            _cases(page, method),
            *_causes(page, method),
            provenance(_facts(entry, method)),
        ),
        version=joined.base.versions.get("eventsweep", ""),
        links=tuple(links),
    )


def _ranks(page: RankingPage, method: str) -> Grid:
    """Its rank by every metric, and on the hidden part."""
    heads = (
        "ranked by", Head("rank"), Head("of"), Head("value, mean of cases"),
        "unit",
    )  # fmt: skip
    lines: list[tuple[object, ...]] = []
    for metric in OTHERS:
        if metric not in page.joined.base.units:
            continue
        found, head = summary.ranked(page.joined, metric), column(metric)
        value = summary.arithmetic(page.joined, method, metric, page.joined.cases)
        cell = value_cell(value, page.joined.base.units[metric][0], float("nan"))
        rank = found.by_method[method].rank
        lines.append(
            (head.title, rank, len(found.standings), cell, head.unit)
        )  # fmt: skip
    if page.hidden and method in page.hidden.by_method:
        rank = page.hidden.by_method[method].rank
        title = f"{column(RANKED_BY).title}, hidden part"
        lines.append((title, rank, len(page.hidden.standings), "", ""))
    return grid(heads, lines)


def _conditions(page: RankingPage, method: str) -> Section:
    joined = page.joined
    groups = {name: summary.cases_of(joined, name) for name in CONDITIONS}
    groups["none of these"] = tuple(c for c in joined.cases if not joined.base.cases[c].conditions)
    heads = (
        "condition", Head("cases"), Head("mean place"),
        Head("relative error", "%", arrow=True), Head("coverage", "%", "higher", arrow=True),
    )  # fmt: skip
    lines = []
    for name, cases in groups.items():
        if not cases:
            continue
        values = (
            summary.mean_places(joined, page.methods, cases)[method],
            summary.geometric(joined, method, "abs_rel", cases),
            summary.arithmetic(joined, method, "completeness", cases),
        )
        lines.append((
            name, len(cases),
            *(value_cell(value, "%", float("nan")) for value in values),
        ))  # fmt: skip
    text = "What makes a case hard; a case may have several conditions. Place 1 is best."
    return Section("conditions", "Conditions", (Text(text), grid(heads, lines)))


def _cases(page: RankingPage, method: str) -> Section:
    joined = page.joined
    metrics = [metric for metric in _SHOWN if metric in joined.base.units]
    heads = (
        "case", "conditions",
        *(column(metric).head() for metric in metrics),
    )  # fmt: skip
    lines = tuple(
        (
            case, ", ".join(joined.base.cases[case].conditions),
            *(
                value_cell(
                    finite_mean(joined.of_case(method, metric, case)),
                    joined.base.units[metric][0], float("nan"),
                )
                for metric in metrics
            ),
        )
        for case in joined.cases
    )  # fmt: skip
    return Section("cases", "Cases", (Text("Means over the seeds."), grid(heads, lines)))


def _causes(page: RankingPage, method: str) -> Iterator[Section]:
    found = summary.causes(page.joined, method)
    if found is None:
        return
    share, parts = found
    heads = ("cause", Head("of its outliers", "%"), "meaning")
    lines = tuple(
        (name.replace("_", " "), value_cell(parts[name], "%", float("nan")),
         meaning if math.isfinite(parts[name]) else f"not measured: {meaning}")
        for name, meaning in CAUSES.items()
    )  # fmt: skip
    text = f"{share:.2f} % of its points are off by more than a tenth of the true depth."
    yield Section("causes", "Why points are wrong", (Text(text), grid(heads, lines)))


def _facts(entry: RankingEntry, method: str) -> Grid:
    """Who made it, with which settings, and what identifies it."""
    stated, cost = entry.stated.get(method), entry.cost.get(method)
    settings = entry.settings.get(method)
    facts = {"result": entry.label, "suite": f"{entry.suite} ({entry.digest})"}
    if stated is not None:
        facts |= {
            "submitted by": ", ".join(stated.authors), "licence": stated.licence,
            "address": stated.url or "not stated",
            "stated cost": f"{stated.cost.seconds_per_window:g} s per window, "
            f"{stated.cost.peak_memory_mb:g} MB, {stated.cost.hardware}",
        }  # fmt: skip
    if method in entry.digests:
        facts["digest of the submission"] = entry.digests[method]
    if settings is not None:
        named = (f"{name} = {value}" for name, value in settings.items())
        facts["settings"] = ", ".join(named) or "the mapper's defaults"
    if cost is not None:
        facts["measured cost"] = (
            f"{cost.cpu_seconds:.3g} CPU s per window, {cost.peak_memory_mb:.0f} MB, on "
            f"{entry.platform or 'an unnamed machine'}"
        )
    facts["eventsweep"] = entry.versions.get("eventsweep", "not recorded")
    return grid(("what", "this method"), list(facts.items()))
