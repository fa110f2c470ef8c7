"""What a ranking says of each method: over conditions, over coverage, at what cost, over time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np

from eventsweep.eval.results.direction import Direction
from eventsweep.eval.scoring.method_scores import BAD_POINTS, CAUSE_PREFIX
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.scoring.standings import Standing, Table, places, standings
from eventsweep.eval.suite.definition import Condition
from eventsweep.plugins.ranking.entries import (
    COVERAGES,
    RANKED_BY,
    Merged,
    RankingEntry,
    finite_mean,
    join,
)
from eventsweep.plugins.ranking.tracks import OTHERS as TRACKS

MAIN = RANKED_BY
OTHERS = (
    MAIN, "abs_rel", "median_error", "bad_published", "completeness", "f1_5cm", "delta_1",
)  # fmt: skip
CONDITIONS: tuple[str, ...] = get_args(Condition)
_REACHED = 0.5


@dataclass(frozen=True)
class Ranked:
    """The ranking of one part by one metric.

    Attributes:
        joined: the entries.
        metric: its name.
        standings: best first, of the methods that were run on every case.
        lacking: per other method, how many of the cases it lacks.
    """

    joined: Merged
    metric: str
    standings: tuple[Standing, ...]
    lacking: dict[str, int]

    @property
    def by_method(self) -> dict[str, Standing]:
        """The standings by method."""
        return {standing.method: standing for standing in self.standings}


def direction_of(joined: Merged, metric: str) -> Direction:
    """Which direction of a metric is better."""
    return joined.base.units[metric][1]


def table_of(joined: Merged, methods: Sequence[str], metric: str, cases: Sequence[str]) -> Table:
    """Per method and case one value for each seed."""
    return {m: [joined.of_case(m, metric, case) for case in cases] for m in methods}


def ranked(joined: Merged, metric: str = MAIN) -> Ranked:
    """Ranks all methods that were run on every case."""
    methods = joined.complete()
    found = standings(table_of(joined, methods, metric, joined.cases), direction_of(joined, metric))
    lacking = {m: len(lacks) for m in joined.owner if (lacks := joined.lacks(m))}
    some = {method: count for method, count in lacking.items() if count < len(joined.cases)}
    return Ranked(joined, metric, found, some)


def geometric(joined: Merged, method: str, metric: str, cases: Sequence[str]) -> float:
    """Geometric mean over cases of the mean over seeds; NaN where a value is missing."""
    means = [finite_mean(joined.of_case(method, metric, case)) for case in cases]
    return _geometric(means)


def arithmetic(joined: Merged, method: str, metric: str, cases: Sequence[str]) -> float:
    """Mean over cases of the mean over seeds; NaN where a value is missing."""
    return finite_mean(finite_mean(joined.of_case(method, metric, case)) for case in cases)


def _geometric(values: Sequence[float]) -> float:
    if not values or not all(value > 0 for value in values):
        return math.nan
    return math.exp(sum(map(math.log, values)) / len(values))


def cases_of(joined: Merged, condition: str) -> tuple[str, ...]:
    """The ranked cases with a condition."""
    return tuple(c for c in joined.cases if condition in joined.base.cases[c].conditions)


def mean_places(joined: Merged, methods: Sequence[str], cases: Sequence[str]) -> dict[str, float]:
    """Mean place of methods over some cases, by the main metric."""
    if not cases or not methods:
        return dict.fromkeys(methods, math.nan)
    found = places(table_of(joined, methods, MAIN, cases), direction_of(joined, MAIN))
    mean = np.mean([one.mean(axis=1) for one in found], axis=0)
    return dict(zip(methods, map(float, mean), strict=True))


def coverage_curve(
    joined: Merged, method: str, methods: Sequence[str]
) -> list[tuple[float, float]]:
    """Error of a method's surest pixels over how many of all true pixels those are, %.

    The error is relative to that of the middle method on all its pixels, case by case, and then the
    geometric mean of the cases in which the method is sure of so many; where those are fewer than
    half, there is no point. The last point is that of all its pixels.
    """
    usual = {
        case: float(np.median(found))
        for case in joined.cases
        if (found := _known(finite_mean(joined.of_case(m, MAIN, case)) for m in methods))
    }
    curve = []
    for share in COVERAGES:
        errors = {
            case: finite_mean(joined.of_case(method, f"mean_error_top_{share}pct", case))
            for case in usual
        }
        ratios = [errors[case] / usual[case] for case in usual if math.isfinite(errors[case])]
        if ratios and len(ratios) >= _REACHED * len(joined.cases):
            curve.append((float(share), _geometric(ratios)))
    whole = [finite_mean(joined.of_case(method, MAIN, case)) / usual[case] for case in usual]
    last = arithmetic(joined, method, "completeness", joined.cases)
    return [point for point in (*curve, (last, _geometric(whole))) if not math.isnan(point[1])]


def _known(values: Iterable[float]) -> list[float]:
    return [value for value in values if math.isfinite(value)]


def causes(joined: Merged, method: str) -> tuple[float, dict[str, float]] | None:
    """Share of outliers among all points, and of each cause among them, %; pooled over cases.

    A cause counts where it was measured; its share is NaN where it never was.
    """
    points = outliers = 0.0
    found = {cause: np.zeros(2) for cause in CAUSES}  # of this cause, and of any
    for case in joined.cases:
        for unit in joined.units(case):
            entry = joined.owner[method]
            bad = entry.value(method, BAD_POINTS, unit)
            count = entry.value(method, "points", unit)
            if not (bad > 0 and count > 0):
                points += 0.0 if math.isnan(count) else count
                continue
            points, outliers = points + count, outliers + bad
            for cause, counts in found.items():
                share = entry.value(method, CAUSE_PREFIX + cause, unit) / 100
                counts += (bad * share, bad) if math.isfinite(share) else (0, 0)
    shares = {name: 100 * own / of if of else math.nan for name, (own, of) in found.items()}
    if not points or not outliers or not any(map(math.isfinite, shares.values())):
        return None
    return 100 * outliers / points, shares


@dataclass(frozen=True)
class History:
    """How methods did over time: entries of the same sequences, oldest first.

    Attributes:
        labels: of the entries.
        lines: per method, its relative error in each entry; NaN where it was not run.
    """

    labels: tuple[str, ...]
    lines: dict[str, tuple[float, ...]]


def history(entries: Sequence[RankingEntry], joined: Merged) -> History:
    """The relative error of each method that two or more comparable entries have."""
    refused = {label for label, _ in joined.refused}
    kept = [entry for entry in entries if entry.label not in refused]
    alone = [_alone(joined, entry) for entry in kept]
    lines = {
        method: tuple(geometric(one, method, "abs_rel", joined.cases) for one in alone)
        for method in joined.complete()
    }
    repeated = {m: line for m, line in lines.items() if sum(map(math.isfinite, line)) > 1}
    return History(tuple(entry.label for entry in kept), repeated)


def _alone(joined: Merged, entry: RankingEntry) -> Merged:
    """The same cases and seeds, with every method as one entry has it."""
    return joined._replace(owner=dict.fromkeys(joined.owner, entry))


def of_tracks(entries: Sequence[RankingEntry]) -> dict[str, Ranked]:
    """The ranking of each other track that has public entries, by its name."""
    public = [entry for entry in entries if entry.part == "public"]
    found = {name: [one for one in public if one.track == name] for name in TRACKS}
    return {name: ranked(join(own), TRACKS[name].ranked_by) for name, own in found.items() if own}


def parts(entries: Sequence[RankingEntry]) -> tuple[Merged, Merged | None]:
    """The public part and, where there is any, the hidden one.

    Args:
        entries: oldest first, at least one of them public.
    """
    public = [entry for entry in entries if entry.part == "public"]
    hidden = [entry for entry in entries if entry.part == "hidden"]
    return join(public), join(hidden) if hidden else None
