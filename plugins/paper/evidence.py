"""What was measured: numbers of a suite's result by their names, and the maps behind them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.errors import InputError
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.jobs.job import SEQUENCE, stored
from eventsweep.eval.numbers import display_unit, displayed
from eventsweep.eval.report.run_data import MethodData, WindowData
from eventsweep.eval.report.suite_pictures import CaseViews
from eventsweep.eval.results.results import Results, mapper_method
from eventsweep.eval.results.table import EVENTS, POOLED
from eventsweep.eval.scoring.pairing import Truth
from eventsweep.eval.scoring.regions import region_masks
from eventsweep.eval.scoring.significance import stratified_interval

if TYPE_CHECKING:
    import pandas as pd


class Missing(InputError):
    """A number or a map that was not measured: its case was left out, or a job failed."""


class Value(NamedTuple):
    """A mean over cases and seeds, and the ends of its 95 % interval, NaN for one seed."""

    mean: float
    low: float = math.nan
    high: float = math.nan
    unit: str = ""

    def __str__(self) -> str:
        text = displayed(self.mean, self.unit) if self.unit else f"{self.mean:.2f}"
        if math.isfinite(self.low) and self.high > self.low:
            half = (self.high - self.low) / 2
            text += f" ± {displayed(half, self.unit) if self.unit else f'{half:.2f}'}"
        unit = display_unit(self.unit)
        return f"{text} {unit}" if unit and unit != "x" else text


class View(NamedTuple):
    """One window of a sequence as it was seen and mapped.

    `maps` are by method, without the mapper's name.
    """

    window: WindowData
    truth: Truth
    maps: dict[str, MethodData]
    sequence: EventSequence

    @property
    def forward(self) -> NDArray[np.float64]:
        """(3,) the way of camera 0 during the sequence, in its frame at the reference time, m."""
        poses = self.sequence.trajectory.times(self.sequence.rig.T_body_cam[0])
        first, last = poses.span_us
        start, end, here = poses.at(np.array([first, last, self.window.t_us]))
        way: NDArray[np.float64] = here[:3, :3].T @ (end[:3, 3] - start[:3, 3])
        return way


@dataclass(frozen=True)
class Evidence:
    """The result of the suite, and where its maps are."""

    results: Results
    views: CaseViews

    @cached_property
    def _rows(self) -> pd.DataFrame:
        keys = ["case", "seed", "window", "method", "metric"]
        return self.results.rows.set_index(keys).sort_index()

    def _mapped(self, case: str, method: str, mapper: str) -> str:
        if method == EVENTS:
            return method
        return mapper_method(method, mapper or self.views.suite.cases[case].mappers[0])

    def per_seed(
        self, case: str, method: str, metric: str, *, window: str = POOLED, mapper: str = ""
    ) -> NDArray[np.float64]:
        """One value for every seed of a case, in the order of the seeds.

        Args:
            case: its name.
            method: a method, `METHOD track` for maps on found poses, or `events`.
            metric: its name.
            window: a window's name, or all together.
            mapper: whose map; by default the case's first.

        Raises:
            Missing: there is none.
        """
        seeds = sorted(s.seed or 0 for s in self.results.samples if s.case == case)
        name = self._mapped(case, method, mapper)
        try:
            rows = [self._rows.loc[(case, seed, window, name, metric), "value"] for seed in seeds]
        except KeyError:
            rows = []
        if not rows:
            raise Missing(f"{metric} of {name} in {case} was not measured")
        return np.array(rows, np.float64)

    def unit(self, metric: str) -> str:
        """The unit in which a metric is stored."""
        rows = self.results.rows
        return str(rows.loc[rows["metric"] == metric, "unit"].iloc[0])

    def number(
        self, cases: str | Sequence[str], method: str, metric: str, *, window: str = POOLED,
        mapper: str = "",
    ) -> Value:  # fmt: skip
        """The mean over cases of the mean over their seeds."""
        names = (cases,) if isinstance(cases, str) else cases
        strata = [self.per_seed(n, method, metric, window=window, mapper=mapper) for n in names]
        return _mean(strata, self.unit(metric))

    def ratio(
        self, cases: str | Sequence[str], metric: str, method: str, reference: str, *,
        window: str = POOLED, of: Callable[[str], str] = lambda case: case,
    ) -> Value:  # fmt: skip
        """How many times the reference's number a method has: of the same case and seed each.

        Geometric over seeds and cases; `of` names the case of the method's number.
        """
        names = (cases,) if isinstance(cases, str) else cases
        strata = [
            np.log(self.per_seed(of(name), method, metric, window=window))
            - np.log(self.per_seed(name, reference, metric, window=window))
            for name in names
        ]
        mean, low, high, _ = _mean(strata, "")
        return Value(math.exp(mean), math.exp(low), math.exp(high))

    def view(self, case: str, mapper: str = "") -> View:
        """The first window of a case's first seed, with the maps of one of its mappers.

        Raises:
            Missing: it was not mapped, or the cache does not hold it.
        """
        return self._recent(case, mapper)

    @cached_property
    def _recent(self) -> Callable[[str, str], View]:
        """Several statements in a row look at one case; a view of 1 Mpx is some 100 MB."""
        return lru_cache(maxsize=4)(self._opened)

    def _opened(self, case: str, mapper: str) -> View:
        samples = [sample for sample in self.results.samples if sample.case == case]
        if not samples:
            raise Missing(f"{case} was not run")
        score = self.views.score_job(samples[0])
        mappers = list(score.parameters["mappers"])
        at = mappers.index(mapper or mappers[0])
        window = self.views.first_window(score, at)
        sequence = stored(score.needs[0], self.views.cache)
        if window is None or window.truth is None or sequence is None:
            raise Missing(f"the cache does not hold the maps of {case}")
        maps = {method.name: method for method in window.methods}
        opened = EventSequence.open(sequence.path / SEQUENCE)
        config = EvalConfig.model_validate(self.views.suite.score)
        regions = region_masks(opened, window.t_us, window.truth.depth_m, config)
        return View(window, replace(window.truth, regions=regions), maps, opened)


def _mean(strata: Sequence[NDArray[np.float64]], unit: str) -> Value:
    mean = float(np.mean([stratum.mean() for stratum in strata]))
    if any(len(stratum) < 2 for stratum in strata):
        return Value(mean, unit=unit)
    return Value(mean, *stratified_interval(strata), unit)
