"""What two results have in common, how their numbers differ, and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.eval.numbers import displayed
from eventsweep.eval.report.compare.comparability import (
    not_comparable,
    nothing_in_common,
    only_in_one,
    other_sequences,
    other_truth,
    same_data,
    same_time,
)
from eventsweep.eval.report.compare.results import CaseResult, ComparedResult, Number
from eventsweep.eval.report.ranking import RANKING_COLUMNS
from eventsweep.eval.results.direction import Direction, change_of
from eventsweep.eval.scoring.metrics import PRIMARY, PRIMARY_OF_GEOMETRIES
from eventsweep.eval.scoring.significance import (
    ALPHA,
    holm,
    intervals,
    stratified_interval,
    stratified_p,
)
from eventsweep.eval.scoring.trajectories.metrics import PRIMARY_OF_TRAJECTORIES

Conclusion = Literal[
    "better", "worse", "no difference shown", "undecided", "equal", "not comparable", "not judged"
]
Floats = NDArray[np.float64]
JUDGED = (*PRIMARY, *PRIMARY_OF_TRAJECTORIES, *PRIMARY_OF_GEOMETRIES)
"""Numbers of which better and worse are said."""
_NAN = math.nan


@dataclass(frozen=True)
class Difference:
    """One number of two results: of a case, or the mean over cases.

    Attributes:
        case: its name, or `mean of N cases`.
        first: mean over the common seeds, and in each over the common windows, of the first result.
        other: the same of the other result.
        low: lower end of the 95 % interval of `change`; NaN where there is none.
        high: its upper end.
        p: of no difference; NaN where that is not tested.
        p_holm: the same, corrected for all numbers that are tested beside it.
        seeds: how many there are in common.
        why: for people, where the numbers do not say it.
        strata: per case, per seed, the mean difference.
    """

    case: str
    method: str
    metric: str
    unit: str
    direction: Direction
    first: float = _NAN
    other: float = _NAN
    low: float = _NAN
    high: float = _NAN
    p: float = _NAN
    p_holm: float = _NAN
    seeds: int = 0
    verdict: Conclusion = "undecided"
    why: str = ""
    strata: tuple[Floats, ...] = field(default=(), repr=False)

    @property
    def change(self) -> float:
        """The other value minus the first."""
        return self.other - self.first

    @property
    def tendency(self) -> Conclusion:
        """What the change is, for better or worse, however sure it is."""
        found = change_of(self.change, self.direction)
        return "not judged" if found == "changed" or self.direction == "none" else found

    @property
    def lost_to_correction(self) -> bool:
        """Whether it would count as a difference if nothing else had been tested."""
        return self.verdict == "no difference shown" and (self.low > 0 or self.high < 0)

    @property
    def short_label(self) -> str:
        """The verdict, and what the one seed shows that decides nothing."""
        if self.verdict != "undecided" or self.seeds != 1:
            return self.verdict
        return f"undecided, {self.tendency} here"

    @property
    def words(self) -> str:
        """The verdict with its reason, short."""
        return f"{self.verdict} ({self.why})" if self.why else self.verdict


@dataclass(frozen=True)
class Pair:
    """A result compared with the first.

    Attributes:
        cases: per case, method and metric that both have.
        means: the same over all common cases; empty where there is only one.
        data: whether it is the same data, a sentence per case where it is not.
        only_in_one: what only one of them has, a sentence each.
    """

    first: ComparedResult
    other: ComparedResult
    cases: tuple[Difference, ...]
    means: tuple[Difference, ...]
    data: tuple[str, ...]
    only_in_one: tuple[str, ...]

    @property
    def headline(self) -> tuple[Difference, ...]:
        """The judged numbers, over all cases where there are several, metric by metric."""
        found = self.means or self.cases
        return tuple(one for metric in JUDGED for one in found if one.metric == metric)

    def names(self) -> list[str]:
        """The common cases."""
        return list(dict.fromkeys(case.case for case in self.cases))


@dataclass(frozen=True)
class Shift:
    """How one metric moved over all methods of a pair, % of the first result.

    Attributes:
        median: over the methods.
        half: of the 95 % interval of that median over seeds; NaN where there is none.
        methods: how many.
    """

    metric: str
    median: float
    half: float
    methods: int


def shift_of(pair: Pair) -> Shift | None:
    """The shift of the first judged metric that moved from a known value; None without one."""
    moved = [one for one in pair.headline if one.strata and one.first]
    if not moved:
        return None
    metric, half = moved[0].metric, _NAN
    alike = [one for one in moved if one.metric == metric]
    shares = [100 * one.change / abs(one.first) for one in alike]
    if len({tuple(map(len, one.strata)) for one in alike}) == 1:  # every seed has every method
        scale = 100 / np.abs([one.first for one in alike])[:, None]
        cases = zip(*(one.strata for one in alike), strict=True)
        low, high = stratified_interval([np.median(scale * case, axis=0) for case in cases])
        half = (high - low) / 2
    return Shift(metric, float(np.median(shares)), half, len(alike))


def compare_results(results: Sequence[ComparedResult]) -> tuple[Pair, ...]:
    """Compares each further result with the first, with which it must share a number."""
    first, *others = results
    return _judged([_pair(first, other) for other in others])


def _pair(first: ComparedResult, other: ComparedResult) -> Pair:
    names = [case for case in first.names if case in other.names]
    found = [difference for case in names for difference in _differences(case, first, other)]
    if not found:
        raise InputError(nothing_in_common(first, other, JUDGED[0]))
    cases = tuple(_with_intervals(found))
    means = tuple(_means(cases, len(names))) if len(names) > 1 else ()
    data = tuple(text for case in names if (text := same_data(case, first, other)))
    return Pair(first, other, cases, means, data, tuple(only_in_one(first, other)))


def _differences(case: str, first: ComparedResult, other: ComparedResult) -> Iterator[Difference]:
    """Every number of a case that people rank by and both have, without intervals yet."""
    one, two = first.first(case), other.first(case)
    seeds = [seed for seed in first.seeds(case) if seed in other.seeds(case)]
    drawn = other_sequences(case, first, other, seeds)
    for number in one.values:
        if number.metric not in RANKING_COLUMNS or number not in two.values:
            continue
        unit, direction = one.units[number]
        base = Difference(case, number.method, number.metric, unit, direction)
        why = drawn or not_comparable(number, (first, other), (one, two))
        if seeds and not why:
            yield _paired(base, number, first, other, seeds)
            continue
        yield replace(
            base,
            first=_alone(first, case, number),
            other=_alone(other, case, number),
            verdict="not comparable" if why else "undecided",
            why=why or "no seed in common",
        )


def _alone(result: ComparedResult, case: str, number: Number) -> float:
    found = (result.cases[case, seed].values.get(number, {}) for seed in result.seeds(case))
    return _mean([_mean(list(values.values())) for values in found])


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if len(values) else _NAN


def _joined(*parts: str) -> str:
    return "; ".join(part for part in parts if part)


def _paired(
    base: Difference, number: Number, first: ComparedResult, other: ComparedResult,
    seeds: Sequence[int | None],
) -> Difference:  # fmt: skip
    pairs = [
        pair_windows(first.cases[base.case, seed], other.cases[base.case, seed], number)
        for seed in seeds
    ]
    both = [np.isfinite(a) & np.isfinite(b) for a, b in pairs]
    kept = [(a[ok], b[ok]) for (a, b), ok in zip(pairs, both, strict=True) if ok.any()]
    lost = sum(int((~ok).sum()) for ok in both)
    if not kept:
        return replace(base, verdict="not comparable", why="undefined in every window")
    means = np.array([[a.mean(), b.mean()] for a, b in kept])
    return replace(
        base,
        first=float(means[:, 0].mean()),
        other=float(means[:, 1].mean()),
        seeds=len(kept),
        why=_joined(
            f"undefined in {lost} of {sum(map(len, both))} windows" if lost else "",
            "another true depth" if other_truth(base.case, first, other, seeds) else "",
        ),
        strata=tuple(b - a for a, b in kept),
    )


def pair_windows(one: CaseResult, two: CaseResult, number: Number) -> tuple[Floats, Floats]:
    """(N,) values of the windows that both have; of none in common, each one's mean."""
    a, b = (case.values.get(number, {}) for case in (one, two))
    names = [name for name in a if name in b and same_time(one, two, name)]
    if names:
        return np.array([a[name] for name in names]), np.array([b[name] for name in names])
    return np.array([_mean(list(a.values()))]), np.array([_mean(list(b.values()))])


def _with_intervals(found: Sequence[Difference]) -> Iterator[Difference]:
    """Adds intervals, of all numbers of equal windows per seed from the same draws."""
    ends: dict[int, tuple[float, float]] = {}
    sizes = {k: tuple(map(len, one.strata)) for k, one in enumerate(found) if one.strata}
    for size in dict.fromkeys(sizes.values()):
        alike = [k for k, its in sizes.items() if its == size]
        table = np.column_stack([np.concatenate(found[k].strata) for k in alike])
        low, high = intervals(table, size)
        both = zip(map(float, low), map(float, high), strict=True)
        ends |= dict(zip(alike, both, strict=True))
    for k, one in enumerate(found):
        if k not in ends:
            yield one
            continue
        of_seeds = np.array([values.mean() for values in one.strata])
        yield replace(
            one, low=ends[k][0], high=ends[k][1], p=_p(one, [of_seeds]), strata=(of_seeds,)
        )


def _p(one: Difference, strata: Sequence[Floats]) -> float:
    """Only what is judged is tested: every further test would cost the others certainty."""
    if one.metric not in JUDGED or one.direction == "none":
        return _NAN
    return stratified_p(strata)


def _means(cases: Sequence[Difference], count: int) -> Iterator[Difference]:
    """Means over cases, every case weighing the same; says where it is over fewer than `count`."""
    groups: dict[tuple[str, str], list[Difference]] = {}
    for case in cases:
        if case.strata:
            groups.setdefault((case.method, case.metric), []).append(case)
    for group in groups.values():
        strata = [one.strata[0] for one in group]
        low, high = stratified_interval(strata)
        yield Difference(
            f"mean of {count} cases",
            group[0].method, group[0].metric, group[0].unit, group[0].direction,
            _mean([one.first for one in group]), _mean([one.other for one in group]),
            low, high, _p(group[0], strata),
            seeds=min(one.seeds for one in group),
            why=_joined(
                f"{len(group)} of {count} cases" if len(group) < count else "",
                *dict.fromkeys(one.why for one in group),
            ),
            strata=tuple(strata),
        )  # fmt: skip


def _judged(pairs: Sequence[Pair]) -> tuple[Pair, ...]:
    """Verdicts, corrected for the number of tests: over means, and over single cases."""
    means = iter(_corrected([mean for pair in pairs for mean in pair.means]))
    cases = iter(_corrected([case for pair in pairs for case in pair.cases]))
    return tuple(
        replace(
            pair,
            means=tuple(next(means) for _ in pair.means),
            cases=tuple(next(cases) for _ in pair.cases),
        )
        for pair in pairs
    )


def _corrected(found: Sequence[Difference]) -> list[Difference]:
    corrected = holm([one.p for one in found])
    return [_verdict(replace(one, p_holm=p)) for one, p in zip(found, corrected, strict=True)]


def _verdict(one: Difference) -> Difference:
    if not one.strata:
        return one
    if one.metric not in JUDGED or one.direction == "none":
        return replace(one, verdict="not judged")
    if all(not values.any() for values in one.strata):
        return replace(one, verdict="equal")
    if math.isnan(one.p):
        return replace(one, verdict="undecided", why=_joined(f"one seed: {_here(one)}", one.why))
    if not (one.low > 0 or one.high < 0):
        return replace(one, verdict="no difference shown")
    if one.p_holm < ALPHA:
        return replace(one, verdict=one.tendency)
    why = _joined(f"{one.tendency}, but for the number of tests", one.why)
    return replace(one, verdict="no difference shown", why=why)


def _here(one: Difference) -> str:
    return "equal on the whole" if one.tendency == "equal" else f"{one.tendency} here"


def counts_of(found: Iterable[Difference]) -> str:
    """How many of each verdict, in words, and how many of them the correction decided."""
    found = list(found)
    verdicts = [one.verdict for one in found]
    text = ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in dict.fromkeys(verdicts))
    lost = sum(one.lost_to_correction for one in found)
    if lost:
        text += f" ({lost} of these only for the number of tests: the interval leaves out zero)"
    return text


def signed(value: float, unit: str) -> str:
    """A difference as tables print it, with its sign."""
    sign = "+" if value > 0 else "−" if value < 0 else ""
    return sign + displayed(abs(value), unit)


def interval_text(one: Difference) -> str:
    """The 95 % interval of a difference; a dash where there is none."""
    if math.isnan(one.low):
        return "–"
    return f"{signed(one.low, one.unit)} to {signed(one.high, one.unit)}"
