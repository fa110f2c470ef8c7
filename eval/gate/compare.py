"""The gate: is a result worse than the baseline, by more than seeds differ?

With the seeds of the baseline every value has its own counterpart: the same scene, the same motion.
Only the code differs, so a small part of the spread between seeds counts. With other seeds the
means are compared, and the spread decides how far two means of unchanged code may lie apart.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np
from scipy import stats

from eventsweep.emvs.errors import InputError, offer
from eventsweep.eval.results.direction import change_of
from eventsweep.eval.results.series import SPEED_METRIC, Key, Measured, Series
from eventsweep.eval.results.table import EVENTS
from eventsweep.eval.scoring.metrics import PRIMARY
from eventsweep.eval.scoring.trajectories.metrics import PRIMARY_OF_TRAJECTORIES

Status = Literal["changed", "worse", "failed", "gone", "not comparable", "better", "new", "same"]
LOST: tuple[Status, ...] = ("failed", "gone", "not comparable")
"""The baseline asks for a number, and there is none to hold against it."""
RED: tuple[Status, ...] = ("changed", "worse", *LOST)
"""What makes the gate fail, where the number is one that decides."""
COMPARED: tuple[Status, ...] = ("changed", "worse", "better", "same")
"""Two numbers were compared."""

INPUT = ("events", "brighter_share")
"""What the mapper is given. Without a direction: a change says that depth is of other events."""
DECIDING = (
    *PRIMARY, "voting_share", "dropped_tail", *INPUT, SPEED_METRIC, *PRIMARY_OF_TRAJECTORIES,
)  # fmt: skip
"""What decides unless others are chosen: how many depths and how wrong they are, in metres and as
the share that the field calls bad; how many events took part; what went in; and what it cost. Of
trajectories, how far off they are, how fast they drift, and how much of the time they cover."""


@dataclass(frozen=True)
class Choice:
    """Which numbers of baseline and result are looked at, and which of those decide.

    Attributes:
        metrics: that decide; all others are shown and decide nothing.
        cases: the only ones to look at; empty: all.
        methods: likewise, beside the event statistics.
        strict: let what does not decide be red as well where it is missing or not comparable.
    """

    metrics: tuple[str, ...] = DECIDING
    cases: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    strict: bool = False

    def check(self, baseline: Mapping[Key, Series]) -> None:
        """Refuses a name that the baseline does not have: it would choose nothing, silently."""
        own = () if self.metrics == DECIDING else self.metrics
        for what, chosen in (("case", self.cases), ("method", self.methods), ("metric", own)):
            known = {getattr(key, what): None for key in baseline}
            for name in chosen:
                if name not in known:
                    there = offer(known, "it is empty, make it anew")
                    raise InputError(f"the baseline has no {what} {name!r}: {there}")

    def has(self, key: Key) -> bool:
        """Whether a number is looked at."""
        in_method = not self.methods or key.method in (*self.methods, EVENTS)
        return in_method and (not self.cases or key.case in self.cases)

    def decides(self, key: Key, status: Status) -> bool:
        """Whether a verdict on a number counts."""
        return key.metric in self.metrics or (self.strict and status in LOST)


@dataclass(frozen=True)
class Tolerances:
    """How much is nothing.

    Attributes:
        paired: share of the seeds' standard deviation that a mean difference between equal seeds
            may reach.
        error_rate: chance that one of all compared numbers of unchanged code is called worse or
            better, with other seeds.
        relative: share of the baseline that counts as nothing, whatever the spread.
        relative_alone: the same where the baseline has one seed, and so no spread.
        absolute: by unit, what counts as nothing.
        speed: factor by which the mapper may slow down or speed up.
    """

    paired: float = 0.1
    error_rate: float = 1e-3
    relative: float = 0.002
    relative_alone: float = 0.02
    speed: float = 1.5

    def absolute(self, unit: str) -> float:
        """What counts as nothing in this unit."""
        return {"m": 2e-4, "%": 0.02}.get(unit, 0.0)


@dataclass(frozen=True)
class Judgement:
    """What the gate says of one number.

    Attributes:
        baseline: mean of the baseline, over the seeds that are compared.
        value: mean of the result.
        tolerance: what `value` may differ by, either way.
        why: for people, where the numbers do not say it.
        decides: whether it counts; else it is only shown.
    """

    key: Key
    status: Status
    unit: str = ""
    baseline: float = math.nan
    value: float = math.nan
    tolerance: float = math.nan
    why: str = ""
    decides: bool = True

    @property
    def is_red(self) -> bool:
        """Whether it makes the gate fail."""
        return self.decides and self.status in RED

    @property
    def change(self) -> float:
        """Value minus baseline."""
        return self.value - self.baseline

    @property
    def severity(self) -> float:
        """Change in tolerances: what to look at first."""
        if math.isnan(self.change) or self.tolerance == 0:
            return math.inf
        return abs(self.change) / self.tolerance


def compare(
    baseline: Mapping[Key, Series] | None,
    measured: Measured,
    tolerances: Tolerances,
    choice: Choice = Choice(),
) -> list[Judgement]:
    """Judges every number of both, the most telling first; without a baseline all is new.

    Where nothing that decides was compared, a verdict of its own says so, and is red.
    """
    known = {key: one for key, one in (baseline or {}).items() if choice.has(key)}
    tests = sum(not _common(one, measured.series.get(key)) for key, one in known.items())
    found = [_judge(one, measured, tolerances, max(tests, 1)) for one in known.values()]
    fresh = (key for key in measured.series if choice.has(key) and key not in known)
    found += [_new(measured.series[key]) for key in fresh]
    verdicts = [replace(one, decides=choice.decides(one.key, one.status)) for one in found]
    verdicts += _failures(measured, choice)
    if baseline is not None and not measured.failures:
        verdicts += _nothing_compared(verdicts, choice)
    order: Sequence[Status] = (*RED, "better", "new", "same")
    return sorted(
        verdicts,
        key=lambda one: (
            not one.is_red,
            not one.decides,
            order.index(one.status),
            -one.severity,
            one.key,
        ),
    )


def is_red(verdicts: Iterable[Judgement]) -> bool:
    """Whether the gate fails."""
    return any(one.is_red for one in verdicts)


def _failures(measured: Measured, choice: Choice) -> Iterator[Judgement]:
    for name, reason in measured.failures.items():
        if not choice.cases or any(f"/{case}/" in name for case in choice.cases):
            yield Judgement(Key("(jobs)", name, ""), "failed", why=reason)


def _nothing_compared(verdicts: Sequence[Judgement], choice: Choice) -> Iterator[Judgement]:
    """A gate that has compared nothing knows nothing, and must not be green."""
    deciding = [one for one in verdicts if one.decides and one.status != "new"]
    if any(one.status in COMPARED for one in deciding):
        return
    why = f"the baseline has no deciding number of {', '.join(choice.metrics)}"
    if deciding:
        lost = f"{deciding[0].key} is {deciding[0].status}, {deciding[0].why}"
        why = f"none of the {len(deciding)} numbers that decide could be compared: {lost}"
    yield Judgement(Key("(gate)", "", ""), "failed", why=why)


def _new(series: Series) -> Judgement:
    value = _mean(series.values.values())
    if math.isnan(value):
        return Judgement(series.key, "failed", series.unit, why="undefined (NaN)")
    return Judgement(series.key, "new", series.unit, value=value)


def _judge(base: Series, measured: Measured, tolerances: Tolerances, tests: int) -> Judgement:
    current = measured.series.get(base.key)
    if current is None:
        return _absent(base, measured)
    if current.identity != base.identity:
        why = "another case, scene or metric than the baseline's"
        return Judgement(base.key, "not comparable", base.unit, why=why)
    undefined = sorted(seed for seed, value in current.values.items() if not math.isfinite(value))
    if undefined:
        why = f"undefined (NaN) for seed {', '.join(map(str, undefined))}"
        return Judgement(base.key, "failed", base.unit, why=why)
    lost = sorted(set(measured.seeds) - set(current.values))
    if lost and base.metric != SPEED_METRIC:
        why = f"missing for seed {', '.join(map(str, lost))}"
        return Judgement(base.key, "failed", base.unit, why=why)
    if base.metric == SPEED_METRIC:
        return _judge_speed(base, current, tolerances)
    before, now, tolerance = _compared(base, current, tolerances, tests)
    return Judgement(
        base.key, _status(base, now - before, tolerance), base.unit, before, now, tolerance
    )


def _absent(base: Series, measured: Measured) -> Judgement:
    before = _mean(base.values.values())
    if base.case not in measured.cases:
        return Judgement(base.key, "gone", base.unit, before, why="the case was not run")
    if any(f"/{base.case}/" in name for name in measured.failures):
        return Judgement(base.key, "failed", base.unit, before, why="its job failed")
    return Judgement(base.key, "gone", base.unit, before, why="missing or undefined (NaN)")


def _judge_speed(base: Series, current: Series, tolerances: Tolerances) -> Judgement:
    """By a factor, and by the best of all repeats: whatever disturbs only slows down."""
    before, now = min(base.values.values()), min(current.values.values())
    tolerance = before * (tolerances.speed - 1)
    status: Status = "same"
    if now > before * tolerances.speed:
        status = "worse"
    elif now < before / tolerances.speed:
        status = "better"
    return Judgement(base.key, status, base.unit, before, now, tolerance)


def _compared(
    base: Series, current: Series, tolerances: Tolerances, tests: int
) -> tuple[float, float, float]:
    common = _common(base, current)
    spread = _spread(base)
    if common:
        before = _mean(base.values[seed] for seed in common)
        now = _mean(current.values[seed] for seed in common)
        by_spread = tolerances.paired * spread
    else:
        before, now = _mean(base.values.values()), _mean(current.values.values())
        by_spread = spread * _between_means(
            len(base.values), len(current.values), tests, tolerances
        )
    relative = tolerances.relative if len(base.values) > 1 else tolerances.relative_alone
    least = max(tolerances.absolute(base.unit), relative * abs(before))
    return before, now, max(by_spread, least)


def _common(base: Series, current: Series | None) -> list[int]:
    """The result's seeds, if the baseline has every one of them."""
    if current is None or not set(current.values) <= set(base.values):
        return []
    return sorted(current.values)


def _spread(base: Series) -> float:
    """Standard deviation between seeds; 0 where there is one seed."""
    values = list(base.values.values())
    return float(np.std(values, ddof=1)) if len(values) > 1 else 0.0


@cache  # the same few for thousands of series
def _between_means(n: int, k: int, tests: int, tolerances: Tolerances) -> float:
    """Standard deviations that two means of unchanged code lie apart at most.

    Student's t for the spread of n seeds, at a chance that is shared by all tests (Bonferroni).
    """
    if n < 2:
        return 0.0
    chance = tolerances.error_rate / tests
    return float(stats.t.isf(chance / 2, n - 1)) * math.sqrt(1 / n + 1 / k)


def _status(base: Series, change: float, tolerance: float) -> Status:
    found = change_of(change, base.direction, tolerance)
    return "same" if found == "equal" else found


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
