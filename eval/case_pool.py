"""All windows of a case together, added one by one: pixels wait on disk, not in memory."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType

from eval.method_scores import (
    ALL,
    ALL_METRICS,
    COMMON,
    Score,
    cause_scores,
    context_scores,
    full_name,
    metrics_of,
)
from eval.pairing import MethodPairs
from eval.pool_order import MOST
from eval.pooling import Pool
from eval.taxonomy import pooled_causes


class CasePool:
    """Pools every method's windows; a context, which holds a temporary folder."""

    def __init__(self, most: int = MOST) -> None:
        """Prepares to hold at most so many numbers of a kind at once."""
        self._folder = tempfile.TemporaryDirectory(prefix="eventsweep-scores-")
        self._most = most
        self._methods: dict[str, _MethodPool] = {}
        self._windows = 0

    def __enter__(self) -> CasePool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._folder.cleanup()

    def add(self, pairs: Mapping[str, MethodPairs], scores: Mapping[str, list[Score]]) -> None:
        """Adds a window: its pixels by method, and what `score_method` says of them.

        Raises:
            InputError: a window of another rig, or no room on the disk.
        """
        if not self._windows:
            parent = Path(self._folder.name)
            self._methods = {
                method: _MethodPool(parent, f"{number}") for number, method in enumerate(pairs)
            }
        self._windows += 1
        for method, pool in self._methods.items():
            pool.add(pairs[method], {score.metric: score.value for score in scores[method]})

    def scores(self) -> dict[str, list[Score]]:
        """By method: what `score_method` would say of all windows' pixels in one."""
        return {method: pool.scores(self._most) for method, pool in self._methods.items()}


class _MethodPool:
    """One method's windows, by region; regions that a window lacks are left out."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name
        self._regions: dict[str, Pool] = {}
        self._causes: dict[str, int] | None = None
        self._began = False

    def add(self, pairs: MethodPairs, values: Mapping[str, float]) -> None:
        found = {ALL: pairs.own, COMMON: pairs.common, **pairs.regions}
        if not self._began:
            self._regions = {region: self._pool(region) for region in found}
        self._regions = {name: pool for name, pool in self._regions.items() if name in found}
        for region, pool in self._regions.items():
            known = {name: values[full_name(name, region)] for name in metrics_of(region)}
            pool.add(found[region], known)
        before = [self._causes] if self._began else []
        self._causes = pooled_causes([*before, pairs.causes])
        self._began = True

    def scores(self, most: int) -> list[Score]:
        found = [score for region in self._regions for score in self._scores(region, most)]
        return [*found, *cause_scores(self._causes)]

    def _pool(self, region: str) -> Pool:
        metrics = {name: ALL_METRICS[name] for name in metrics_of(region)}
        return Pool(metrics, self._folder, f"{self._name}-{region}")

    def _scores(self, region: str, most: int) -> Iterator[Score]:
        pool = self._regions[region]
        if region == ALL:
            yield from context_scores(pool.truth_points, pool.baseline_focal_px_m)
        for name, value in pool.values(most).items():
            metric = ALL_METRICS[name]
            score_name = full_name(name, region)
            yield Score(score_name, value, metric.unit, metric.better, region, pool.points)
