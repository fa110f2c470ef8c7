"""All windows' pixels together, as one large window, in memory that stays flat.

Most metrics are means over pixels, so the windows' values and numbers of pixels are enough. Medians
and curves need all pixels in order, which `eval.scoring.external_sort` keeps on disk.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType

import numpy as np

from eventsweep.emvs.errors import InputError
from eventsweep.eval.scoring.curves import COVERAGES_PERCENT
from eventsweep.eval.scoring.external_sort import MOST_AT_ONCE, Floats, SortedRuns
from eventsweep.eval.scoring.method_scores import (
    ALL_METRICS,
    Score,
    cause_scores,
    context_scores,
    full_name,
    metrics_of,
)
from eventsweep.eval.scoring.metrics import Metric, Pairs
from eventsweep.eval.scoring.outlier_causes import pooled_causes
from eventsweep.eval.scoring.pairing import ALL, MethodPairs

_NAN = float("nan")


class Pool:
    """The pixels of one method in one region, of any number of windows.

    Attributes:
        points: pixels with an estimate and a truth so far.
        truth_points: pixels with a truth so far.
        baseline_focal_px_m: of the rig, px·m; NaN for a rig of one camera, and before a window.
    """

    def __init__(self, metrics: Mapping[str, Metric], folder: Path, name: str) -> None:
        """Prepares to pool these metrics; files in `folder` begin with `name`."""
        self._metrics = metrics
        self.points = self.truth_points = 0
        self.baseline_focal_px_m = _NAN
        self._sums = dict.fromkeys(metrics, 0.0)
        self._log_ratio: list[tuple[int, float]] = []
        errors, cells, confidence = (
            SortedRuns(folder / f"{name}-{key}") for key in ("errors", "cells", "confidence")
        )
        self._errors = errors if "median_error" in metrics else None
        self._cells = cells if "median_cells" in metrics else None
        self._by_confidence = confidence if "aurc" in metrics else None
        self._windows = 0

    def add(self, pairs: Pairs, values: Mapping[str, float]) -> None:
        """Adds a window.

        Args:
            pairs: its pixels.
            values: its value of each metric.

        Raises:
            InputError: a window of another rig, or no room on the disk.
        """
        self._check_rig(pairs)
        self.points += pairs.count
        self.truth_points += pairs.truth_count
        for name, metric in self._metrics.items():
            if weight := _weight(metric, pairs):
                value = values[name]
                self._sums[name] += weight * (value**2 if metric.pooling == "squares" else value)
        if pairs.count:
            self._log_ratio.append((pairs.count, float(np.mean(pairs.log_ratio))))
        self._keep(pairs)

    def values(self, most: int = MOST_AT_ONCE) -> dict[str, float]:
        """Every metric of all windows' pixels together; NaN where it is undefined."""
        found = {name: self._value(metric) for name, metric in self._metrics.items()}
        if self._errors is not None:
            found["median_error"] = self._errors.median(most)
        if "median_cells" in self._metrics:
            found["median_cells"] = _NAN if self._cells is None else self._cells.median(most)
        if "aurc" in self._metrics:
            found |= self._coverage(most)
        return {name: found[name] for name in self._metrics}

    def _check_rig(self, pairs: Pairs) -> None:
        before, now = self.baseline_focal_px_m, pairs.baseline_focal_px_m
        # No stereo rig at all is NaN, which is like itself here.
        if self._windows and not np.array_equal([before], [now], equal_nan=True):
            raise InputError(
                f"cannot pool windows with baseline x focal length {before} and {now} px·m: "
                "pool windows of one rig"
            )
        self.baseline_focal_px_m, self._windows = now, self._windows + 1

    def _keep(self, pairs: Pairs) -> None:
        error_m = pairs.error_m
        self._errors = _added(self._errors, error_m)
        # Half a column is not comparable: one window without it, and there is none.
        self._cells = _added(self._cells, pairs.cells)
        if pairs.confidence is None:
            self._by_confidence = None
        elif self._by_confidence is not None:
            self._by_confidence.add(-pairs.confidence, error_m)

    def _value(self, metric: Metric) -> float:
        total, name = self._sums[metric.name], metric.name
        if metric.pooling == "sum":
            return total
        if metric.pooling == "order":
            return _NAN  # found elsewhere
        if metric.name.endswith(("cells", "cell")) and self._cells is None:
            return _NAN
        if metric.pooling == "truth":
            return total / self.truth_points if self.truth_points else _NAN
        if metric.pooling == "either":
            either = self.points + self.truth_points
            return total / either if either else _NAN
        if not self.points:
            return _NAN
        mean = self._sums[name] / self.points
        if metric.pooling == "squares":
            return math.sqrt(mean)
        return mean + self._between() if metric.pooling == "variance" else mean

    def _between(self) -> float:
        """The part of a variance that lies between windows, x 100."""
        counts, means = map(np.array, zip(*self._log_ratio, strict=True))
        mean = np.sum(counts * means) / np.sum(counts)
        return 100 * float(np.sum(counts * (means - mean) ** 2) / np.sum(counts))

    def _coverage(self, most: int) -> dict[str, float]:
        """The curves of all windows' pixels; every chunk goes on where the last one ended."""
        names = {percent: f"mean_error_top_{percent}pct" for percent in COVERAGES_PERCENT}
        found = dict.fromkeys(("aurc", "ause", *names.values()), _NAN)
        if self._by_confidence is None or self._errors is None or not self.points:
            return found
        area = least = before = error_sum = best_sum = 0.0
        best = _SmallestErrors(self._errors, most)
        for keys, error_m in self._by_confidence.chunks(most):
            last = np.append(keys[1:] != keys[:-1], True)
            points = before + np.flatnonzero(last) + 1
            errors = _cumulative(error_sum, error_m)
            bests = _cumulative(best_sum, best.take(len(keys)))
            steps, mean_m = np.diff(points, prepend=before), errors[last] / points
            area += float(np.sum(steps * mean_m))
            least += float(np.sum(steps * (mean_m - bests[last] / points)))
            for percent, name in names.items():
                enough = 100 * points / self.truth_points >= percent
                if math.isnan(found[name]) and enough.any():
                    found[name] = float(mean_m[np.argmax(enough)])
            before, error_sum, best_sum = float(points[-1]), float(errors[-1]), float(bests[-1])
        found["aurc"], found["ause"] = area / self.points, max(0.0, least / self.points)
        return found


class _SmallestErrors:
    """Errors in order, in pieces of any length."""

    def __init__(self, errors: SortedRuns, most: int) -> None:
        self._chunks, self._rest = errors.chunks(most), np.empty(0)

    def take(self, count: int) -> Floats:
        """The next `count` errors."""
        parts = [self._rest]
        while sum(map(len, parts)) < count:
            parts.append(next(self._chunks)[0])
        whole = np.concatenate(parts)
        self._rest = whole[count:]
        return whole[:count]


def _cumulative(before: float, numbers: Floats) -> Floats:
    """Cumulative sums that go on from `before`."""
    found: Floats = np.cumsum(np.concatenate([[before], numbers]))[1:]
    return found


def _added(store: SortedRuns | None, numbers: Floats | None) -> SortedRuns | None:
    if store is None or numbers is None:
        return None
    store.add(numbers)
    return store


def _weight(metric: Metric, pairs: Pairs) -> int:
    """How much a window's value counts; 0 where it has none."""
    if metric.pooling == "truth":
        return pairs.truth_count
    if metric.pooling == "either":
        return pairs.count + pairs.truth_count
    return 1 if metric.pooling == "sum" else pairs.count


class CasePool:
    """Pools every method's windows; a context, which holds a temporary folder."""

    def __init__(self, most: int = MOST_AT_ONCE) -> None:
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
        found = pairs.by_region
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
