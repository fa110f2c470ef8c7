"""Who is ahead, and how surely: places in every case and seed, ties where seeds do not tell.

Errors of different scenes have different sizes, so a mean over scenes is that of the largest one.
Methods are placed instead in every case and seed (1 is best; equal values share a place; who has no
value is last), and their places averaged: over seeds, then over cases (Demšar, JMLR 7, 2006). Cases
are what they are, seeds are drawn: two methods tie unless the mean difference of their places over
seeds is significant (`stratified_p`, corrected after Holm).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from eventsweep.eval.results.direction import Direction
from eventsweep.eval.scoring.significance import ALPHA, holm, stratified_p

Floats = NDArray[np.float64]
Table = Mapping[str, Sequence[Sequence[float]]]
"""Per method and case one value for each seed; the seeds of a case are the same for all methods."""
RULE = (
    "In every case and seed, methods are placed by their {title} (1 is best), and places are "
    "averaged; every case weighs the same. Methods share a rank where the difference of their "
    "places is not significant over seeds (95 %, corrected for the number of pairs)."
)
"""Who is ahead on every page, in the same words."""
_MOST_NAMED = 4


@dataclass(frozen=True, slots=True)
class Standing:
    """A method's place.

    Attributes:
        method: its name.
        rank: 1 plus the number of methods that are significantly better: ties share a rank. None is
            ranked behind a method of a worse mean place.
        place: mean of its places.
        values: (C,) mean over seeds of the metric itself, per case; NaN where one is undefined.
    """

    method: str
    rank: int
    place: float
    values: tuple[float, ...]


def standings(table: Table, direction: Direction, *, alpha: float = ALPHA) -> tuple[Standing, ...]:
    """Ranks methods, best mean place first.

    Args:
        table: per method and case, one value for each seed; NaN where it has none.
        direction: which end of the metric is better.
        alpha: a corrected p below it tells two methods apart.
    """
    methods = list(table)
    if not methods:
        return ()
    by_case = places(table, direction)
    mean = np.mean([found.mean(axis=1) for found in by_case], axis=0)
    losses = _losses(by_case, mean, alpha)
    found = [
        Standing(
            method,
            1 + int(losses[k]),
            float(mean[k]),
            tuple(float(np.mean(values)) for values in table[method]),
        )
        for k, method in enumerate(methods)
    ]
    return _in_order(sorted(found, key=lambda one: (one.place, one.method)))


def _in_order(found: Sequence[Standing]) -> tuple[Standing, ...]:
    """Ranks that grow with mean places: some pairs are told apart more easily than others."""
    least, kept = len(found), []
    for one in reversed(found):
        least = min(least, one.rank)
        kept.append(replace(one, rank=least))
    return tuple(reversed(kept))


def places(table: Table, direction: Direction) -> list[Floats]:
    """Per case the (M, S) places of methods with each seed; equal ones share the middle."""
    sign = -1.0 if direction == "higher" else 1.0
    found = []
    for values in zip(*table.values(), strict=True):
        badness = sign * np.asarray(values, np.float64)
        badness[np.isnan(badness)] = np.inf
        found.append(rankdata(badness, axis=0))
    return found


def _losses(by_case: Sequence[Floats], mean: Floats, alpha: float) -> NDArray[np.intp]:
    """How many methods are significantly better than each."""
    couples = list(combinations(range(len(mean)), 2))
    p = [stratified_p([found[a] - found[b] for found in by_case]) for a, b in couples]
    losses = np.zeros(len(mean), np.intp)
    for (a, b), corrected in zip(couples, holm(p), strict=True):
        if corrected < alpha:
            losses[a if mean[a] > mean[b] else b] += 1
    return losses


def lead_words(found: Sequence[Standing], seeds: int) -> str:
    """Who is first, best mean place first; with one seed, as far as that says anything."""
    first = [one.method for one in found if one.rank == 1]
    if seeds < 2:
        here = [one.method for one in found if one.place == found[0].place]
        verb = "are" if len(here) > 1 else "is"
        return (
            "One seed says nothing about others, so all methods share the first rank; in this one "
            f"{_several(here)} {verb} placed first."
        )
    if len(first) == 1:
        return f"{first[0]} is first."
    return f"{_several(first)} do not differ significantly: they share the first rank."


def _several(names: Sequence[str]) -> str:
    few = len(names) <= _MOST_NAMED
    return ", ".join(names) if few else f"{names[0]} and {len(names) - 1} others"
