"""The gate: does a result differ from the baseline, by more than unchanged code differs?

How much that is depends on what the numbers were made of. Of the same sequences, by hash, unchanged
code makes the same numbers. Of sequences that the same simulator drew anew from the same scene and
settings, nearly the same: another processor or graphics library moves a few events. Else, with the
seeds of the baseline, every value has its counterpart of the same motion, and a small part of the
spread between seeds counts; with other seeds the spread decides how far two means may lie apart.
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
from eventsweep.eval.results.series import (
    ON,
    SIGNED_ERRORS,
    SPEED_METRIC,
    Key,
    Measured,
    Origin,
    Series,
)
from eventsweep.eval.results.table import EVENTS
from eventsweep.eval.scoring.metrics import PRIMARY, PRIMARY_OF_GEOMETRIES
from eventsweep.eval.scoring.trajectories.metrics import PRIMARY_OF_TRAJECTORIES

Alike = Literal["sequence", "recipe", "seeds", "nothing"]
"""What baseline and result have in common: the sequences; what they were drawn from; the seeds."""
Status = Literal["changed", "worse", "failed", "gone", "not comparable", "better", "new", "same"]
LOST: tuple[Status, ...] = ("failed", "gone", "not comparable")
"""The baseline asks for a number, and there is none to hold against it."""
RED: tuple[Status, ...] = ("changed", "worse", *LOST)
"""What makes the gate fail, where the number is one that decides."""
COMPARED: tuple[Status, ...] = ("changed", "worse", "better", "same")
"""Two numbers were compared."""

INPUT = ("events", "brighter_share")
"""What the mapper is given. Without a direction: a change says that depth is of other events."""
WITHOUT_TRUTH = ("reported", "median_depth")
"""Of maps without ground truth: how many depths there are, and how far away."""
DECIDING = (
    *PRIMARY, *SIGNED_ERRORS, *WITHOUT_TRUTH, "voting_share", "dropped_tail", *INPUT,
    SPEED_METRIC, *PRIMARY_OF_TRAJECTORIES, *PRIMARY_OF_GEOMETRIES,
)  # fmt: skip
"""What decides unless others are chosen: how many depths and how wrong they are, in metres and as
the share that the field calls bad; whether they lie too near or too far, which makes some of them
better; how many events took part; what went in; and what it cost. Of trajectories, how far off they
are, how fast they drift, and how much of the time they cover; of geometries, how
wrong, how much is missing, and both."""


@dataclass(frozen=True)
class Choice:
    """Which numbers of baseline and result are looked at, and which of those decide.

    Attributes:
        metrics: that decide; all others are shown and decide nothing.
        cases: the only ones to look at; empty: all.
        methods: likewise, beside the event statistics.
        strict: let every number of the same sequences decide, and make what is better red, too:
            there a change is one of the code. What is missing or cannot be compared is red anyhow.
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

    def weighed(self, verdict: Judgement) -> Judgement:
        """The verdict with whether it counts, and whether it is red."""
        repeats = verdict.alike == "sequence"
        asked = verdict.key.metric in self.metrics
        decides = asked or (self.strict and (repeats or verdict.status in LOST))
        red = (*RED, "better") if self.strict and repeats else RED
        return replace(verdict, decides=decides, is_red=decides and verdict.status in red)


_REPEATED = 1e-3
"""The part of what counts as nothing that does where the sequences are the same."""


@dataclass(frozen=True)
class Tolerances:
    """How much is nothing.

    Attributes:
        same_sequence: share of the baseline that counts as nothing where the sequences are the
            same by hash. Unchanged code repeats each number to the last bit, whatever the threads
            and the processor's name; a baseline keeps seven digits.
        same_recipe: likewise where the same simulator drew them from the same scene and settings:
            code for another processor, and vectors of another width in the graphics library, change
            the 1,290 numbers of `quick` by up to 0.74 %, 99 % of them by less than 0.07 %.
        paired: share of the seeds' standard deviation that a mean difference between equal seeds
            may reach.
        error_rate: chance that one of all compared numbers of unchanged code is called worse or
            better, with other seeds.
        relative: share of the baseline that counts as nothing, whatever the spread.
        relative_alone: the same where the baseline has one seed, and so no spread.
        absolute: by unit, what counts as nothing.
        speed: factor by which the mapper may slow down or speed up.
    """

    same_sequence: float = 1e-5
    same_recipe: float = 0.01
    paired: float = 0.1
    error_rate: float = 1e-3
    relative: float = 0.002
    relative_alone: float = 0.02
    speed: float = 1.5

    def absolute(self, unit: str) -> float:
        """What counts as nothing in this unit."""
        return {"m": 2e-4, "%": 0.02, "cells": 0.02, "px": 0.01}.get(unit, 0.0)


@dataclass(frozen=True)
class Judgement:
    """What the gate says of one number.

    Attributes:
        baseline: mean of the baseline, over the seeds that are compared.
        value: mean of the result.
        tolerance: what `value` may differ by, either way.
        why: for people, where the numbers do not say it.
        alike: what the compared numbers have in common; None where none were, or times.
        decides: whether it counts; else it is only shown.
        is_red: whether it makes the gate fail.
    """

    key: Key
    status: Status
    unit: str = ""
    baseline: float = math.nan
    value: float = math.nan
    tolerance: float = math.nan
    why: str = ""
    alike: Alike | None = None
    decides: bool = True
    is_red: bool = False

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
    known = {key: series for key, series in (baseline or {}).items() if choice.has(key)}
    tests = sum(not _common(series, measured.series.get(key)) for key, series in known.items())
    judged = [_judge(series, measured, tolerances, max(tests, 1)) for series in known.values()]
    fresh = (key for key in measured.series if choice.has(key) and key not in known)
    judged += [_new(measured.series[key]) for key in fresh]
    verdicts = [choice.weighed(verdict) for verdict in judged]
    verdicts += _failures(measured, choice)
    if baseline is not None and not measured.failures:
        verdicts += _nothing_compared(verdicts, choice)
    return sorted(verdicts, key=_place)


_ORDER: Sequence[Status] = (*RED, "better", "new", "same")


def _place(verdict: Judgement) -> tuple[object, ...]:
    """Where a verdict stands: first what fails the gate, of that what is of the events."""
    return (
        not verdict.is_red, not verdict.decides, verdict.key.method != EVENTS,
        _ORDER.index(verdict.status), -verdict.severity, verdict.key,
    )  # fmt: skip


def is_red(verdicts: Iterable[Judgement]) -> bool:
    """Whether the gate fails."""
    return any(verdict.is_red for verdict in verdicts)


def _failures(measured: Measured, choice: Choice) -> Iterator[Judgement]:
    for name, reason in measured.failures.items():
        if not choice.cases or any(f"/{case}/" in name for case in choice.cases):
            yield Judgement(Key("(jobs)", name, ""), "failed", why=reason, is_red=True)


def _nothing_compared(verdicts: Sequence[Judgement], choice: Choice) -> Iterator[Judgement]:
    """A gate that has compared nothing knows nothing, and must not be green."""
    deciding = [verdict for verdict in verdicts if verdict.decides and verdict.status != "new"]
    if any(one.status in COMPARED for one in deciding):
        return
    why = f"the baseline has no deciding number of {', '.join(choice.metrics)}"
    if deciding:
        lost = f"{deciding[0].key} is {deciding[0].status}, {deciding[0].why}"
        why = f"none of the {len(deciding)} numbers that decide could be compared: {lost}"
    yield Judgement(Key("(gate)", "", ""), "failed", why=why, is_red=True)


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
        return _timed_elsewhere(base, current) or Judgement(
            base.key, "not comparable", base.unit, why=_unlike(base, current)
        )
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
    alike = _alike(base, current)
    before, now, tolerance = _compared(base, current, alike, tolerances, tests)
    status = _status(base, now - before, tolerance)
    return Judgement(base.key, status, base.unit, before, now, tolerance, alike=alike)


def _timed_elsewhere(base: Series, current: Series) -> Judgement | None:
    """Speed on another processor than the baseline's has no counterpart: it is new."""
    (of, _, before), (same, _, now) = (one.identity.partition(ON) for one in (base, current))
    if base.metric != SPEED_METRIC or of != same:
        return None
    why = f"timed on {now}, the baseline on {before or 'an unnamed processor'}"
    return replace(_new(current), value=min(current.values.values()), why=why)


def _unlike(base: Series, current: Series) -> str:
    """Why two series cannot be compared, as far as is known."""
    origins = _origins(base, current)
    if all(before.sequence and before.sequence == now.sequence for before, now in origins):
        return "another way to score, or another metric, than the baseline's"
    if all(before.recipe and before.recipe == now.recipe for before, now in origins):
        return "another sequence than the baseline's, simulated with the same settings"
    if all(before.sequence and now.sequence for before, now in origins):
        return "another sequence than the baseline's"
    return "another case, scene or metric than the baseline's"


def _origins(base: Series, current: Series) -> list[tuple[Origin, Origin]]:
    """What both were made of, for each seed of the result."""
    unknown = Origin()
    return [
        (base.origins.get(seed, unknown), current.origins.get(seed, unknown))
        for seed in current.values
    ]


def _alike(base: Series, current: Series) -> Alike:
    if not _common(base, current):
        return "nothing"
    origins = _origins(base, current)
    if all(before.sequence and before.sequence == now.sequence for before, now in origins):
        return "sequence"
    if all(before.recipe and before.recipe == now.recipe for before, now in origins):
        return "recipe"
    return "seeds"


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
    base: Series, current: Series, alike: Alike, tolerances: Tolerances, tests: int
) -> tuple[float, float, float]:
    """The two means, and how far they may lie apart."""
    common = _common(base, current)
    if not common:
        before, now = _mean(base.values.values()), _mean(current.values.values())
        apart = _between_means(len(base.values), len(current.values), tests, tolerances)
        by_spread = _spread(base) * apart
    else:
        before = _mean(base.values[seed] for seed in common)
        now = _mean(current.values[seed] for seed in common)
        by_spread = 0.0 if alike == "sequence" else tolerances.paired * _spread(base)
    relative = _relative(base, alike, tolerances)
    absolute = tolerances.absolute(base.unit)
    if alike == "sequence":  # of what repeats, less counts as nothing
        absolute *= _REPEATED
    return before, now, max(by_spread, absolute, relative * abs(before))


def _relative(base: Series, alike: Alike, tolerances: Tolerances) -> float:
    if alike == "sequence":
        return tolerances.same_sequence
    if alike == "recipe":
        return tolerances.same_recipe
    return tolerances.relative if len(base.values) > 1 else tolerances.relative_alone


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
