"""A study's rows as curves: per method and amount the error over all samples, with a band."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

METRICS = ("mean_error", "bad_published", "points")
BREAKS_AT = 2.0
"""A method breaks where its error is this many times its unperturbed one."""

_DRAWS = 2000
_COVERAGE = (2.5, 97.5)


@dataclass(frozen=True, slots=True)
class StudyValue:
    """One number of a study."""

    case: str
    seed: int
    amount: float
    method: str
    metric: str
    value: float
    unit: str


@dataclass(frozen=True, eq=False)
class RobustnessCurve:
    """One metric of one method over the amounts.

    Attributes:
        method: its name.
        metric: its name.
        unit: of the values.
        amounts: (A,) in the study's order.
        mean: (A,) mean over cases of the mean over seeds; NaN where a sample has no value.
        low: (A,) lower end of the 95 % band.
        high: (A,) upper end.
        samples: (A,) samples with a value.
    """

    method: str
    metric: str
    unit: str
    amounts: tuple[float, ...]
    mean: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    samples: NDArray[np.int64]

    def breaking_amount(self) -> float | None:
        """The amount at which the value passes `BREAKS_AT` times its first one, interpolated.

        None where it never does. Amounts without a value count as broken: there is no map.
        """
        limit = BREAKS_AT * self.mean[0]
        broken = ~(self.mean <= limit)
        if not np.isfinite(self.mean[0]) or not broken.any():
            return None
        k = int(np.argmax(broken))
        if not np.isfinite(self.mean[k]):
            return self.amounts[k]
        share = (limit - self.mean[k - 1]) / (self.mean[k] - self.mean[k - 1])
        return float(self.amounts[k - 1] + share * (self.amounts[k] - self.amounts[k - 1]))


def curves(
    values: Iterable[StudyValue],
    amounts: Sequence[float],
    methods: Sequence[str],
    cases: Sequence[str],
) -> list[RobustnessCurve]:
    """One curve per method and metric, in that order.

    Args:
        values: of all cases, seeds and amounts that could be scored.
        amounts: in the study's order.
        methods: in the order wanted.
        cases: whose means are averaged.
    """
    found: dict[tuple[str, str, float, str], list[float]] = {}
    units: dict[str, str] = {}
    for one in values:
        found.setdefault((one.method, one.metric, one.amount, one.case), []).append(one.value)
        units[one.metric] = one.unit
    return [
        _curve(found, method, metric, units.get(metric, ""), amounts, cases)
        for metric in METRICS
        for method in methods
    ]


def _curve(
    found: Mapping[tuple[str, str, float, str], list[float]],
    method: str, metric: str, unit: str, amounts: Sequence[float], cases: Sequence[str],
) -> RobustnessCurve:  # fmt: skip
    groups = [
        [np.array(found.get((method, metric, amount, case), [math.nan])) for case in cases]
        for amount in amounts
    ]
    mean = np.array([np.mean([group.mean() for group in one]) for one in groups])
    bands = np.array([_band(one) for one in groups])
    samples = np.array([sum(np.isfinite(group).sum() for group in one) for one in groups])
    return RobustnessCurve(
        method, metric, unit, tuple(amounts), mean, bands[:, 0], bands[:, 1], samples
    )


def _band(groups: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """95 % percentile bootstrap over the seeds of every case, the cases held fixed."""
    rng = np.random.default_rng(0)
    draws = [rng.choice(group, (_DRAWS, len(group))).mean(axis=1) for group in groups]
    means = np.mean(draws, axis=0)
    if not np.all(np.isfinite(means)):
        return np.full(2, np.nan)
    band: NDArray[np.float64] = np.percentile(means, _COVERAGE)
    return band
