"""All windows' pixels together, as one large window.

Most metrics are means over pixels, so the windows' values and numbers of pixels are enough. Medians
and curves need all pixels: their errors are kept in memory, beyond `MOST_BYTES` in a temporary
file, and those of one method are read back at a time.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from tempfile import SpooledTemporaryFile

import numpy as np

from eventsweep.emvs.errors import InputError
from eventsweep.eval.scoring.curves import coverage_scores
from eventsweep.eval.scoring.method_scores import (
    ALL_METRICS,
    Score,
    cause_scores,
    context_scores,
    full_name,
    metrics_of,
)
from eventsweep.eval.scoring.metrics import NAN, FloatArray, Metric, Pairs
from eventsweep.eval.scoring.outlier_causes import pooled_causes
from eventsweep.eval.scoring.pairing import ALL, MethodPairs

MOST_BYTES = 1 << 30
"""How much a case keeps in memory for medians and curves; 40 million pixels of a method."""


class NumberStore(SpooledTemporaryFile[bytes]):
    """Keeps arrays in memory, and in a temporary file once they exceed a size; a context."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        super().__init__(max(most_bytes, 1), prefix="eventsweep-scores-")  # 0 would be no limit

    def keep(self, numbers: FloatArray) -> Callable[[], FloatArray]:
        """Keeps an array, which the returned function gives back."""
        try:
            start = self.seek(0, os.SEEK_END)
            self.write(numbers.tobytes())
            self.flush()
        except OSError as error:
            raise InputError(
                f"{tempfile.gettempdir()}: cannot keep the scores of a window there "
                f"({error.strerror}): free some space, or set TMPDIR to another folder"
            ) from error
        return partial(self._kept, start, numbers.nbytes, numbers.dtype)

    def _kept(self, start: int, size: int, dtype: np.dtype[np.float64]) -> FloatArray:
        self.seek(start)
        return np.frombuffer(self.read(size), dtype)


class _Column:
    """One number per pixel, of all windows; undefined once a window lacks it."""

    def __init__(self, store: NumberStore) -> None:
        self._store = store
        self._parts: list[Callable[[], FloatArray]] | None = []

    def add(self, numbers: FloatArray | None) -> None:
        # Half a column is not comparable: one window without it, and there is none.
        if numbers is None:
            self._parts = None
        elif self._parts is not None:
            self._parts.append(self._store.keep(numbers))

    @property
    def is_defined(self) -> bool:
        return self._parts is not None

    def numbers(self) -> FloatArray:
        return np.concatenate([np.empty(0), *(part() for part in self._parts or ())])

    def medians(self) -> tuple[float, float]:
        """Of the numbers without their signs, and with them."""
        numbers = self.numbers()
        if not numbers.size:
            return NAN, NAN
        return float(np.median(np.abs(numbers))), float(np.median(numbers))


class Pool:
    """The pixels of one method in one region, of any number of windows.

    `baseline_focal_px_m` is NaN for a rig of one camera, and before a window.
    """

    def __init__(self, metrics: Mapping[str, Metric], store: NumberStore) -> None:
        self._metrics = metrics
        self.points = self.truth_points = 0
        self.baseline_focal_px_m = NAN
        self._sums = dict.fromkeys(metrics, 0.0)
        self._log_ratio: list[tuple[int, float]] = []
        self._errors, self._disparities, self._cells, self._confidence = (
            _Column(store) for _ in range(4)
        )
        self._windows = 0

    def add(self, pairs: Pairs, values: Mapping[str, float]) -> None:
        """Adds a window: its pixels, and its value of each metric."""
        self._check_rig(pairs)
        self.points += pairs.count
        self.truth_points += pairs.truth_count
        for name, metric in self._metrics.items():
            if weight := _weight(metric, pairs):
                value = values[name]
                self._sums[name] += weight * (value**2 if metric.pooling == "squares" else value)
        if pairs.count:
            self._log_ratio.append((pairs.count, float(np.mean(pairs.log_ratio))))
        if {"median_error", "aurc"} & self._metrics.keys():
            self._errors.add(pairs.signed_error_m)
        if "bias_px" in self._metrics:
            self._disparities.add(pairs.signed_disparity_px)
        if "median_cells" in self._metrics:
            self._cells.add(pairs.signed_cells)
        if "aurc" in self._metrics:
            self._confidence.add(pairs.confidence)

    def values(self) -> dict[str, float]:
        """Every metric of all windows' pixels together; NaN where it is undefined."""
        found = {name: self._value(metric) for name, metric in self._metrics.items()}
        found["median_error"], found["bias"] = self._errors.medians()
        found["median_cells"], found["bias_cells"] = self._cells.medians()
        found["bias_px"] = self._disparities.medians()[1]
        if "aurc" in self._metrics:
            confidence = self._confidence.numbers() if self._confidence.is_defined else None
            found |= coverage_scores(np.abs(self._errors.numbers()), confidence, self.truth_points)
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

    def _value(self, metric: Metric) -> float:
        total, name = self._sums[metric.name], metric.name
        if metric.pooling == "sum":
            return total
        if metric.pooling == "order":
            return NAN  # `values` sets it
        if metric.name.endswith(("cells", "cell")) and not self._cells.is_defined:
            return NAN
        if metric.pooling == "truth":
            return total / self.truth_points if self.truth_points else NAN
        if metric.pooling == "either":
            either = self.points + self.truth_points
            return total / either if either else NAN
        if not self.points:
            return NAN
        mean = self._sums[name] / self.points
        if metric.pooling == "squares":
            return math.sqrt(mean)
        return mean + self._between() if metric.pooling == "variance" else mean

    def _between(self) -> float:
        """The part of a variance that lies between windows, x 100."""
        counts, means = map(np.array, zip(*self._log_ratio, strict=True))
        mean = np.sum(counts * means) / np.sum(counts)
        return 100 * float(np.sum(counts * (means - mean) ** 2) / np.sum(counts))


def _weight(metric: Metric, pairs: Pairs) -> int:
    """How much a window's value counts; 0 where it has none."""
    if metric.pooling == "truth":
        return pairs.truth_count
    if metric.pooling == "either":
        return pairs.count + pairs.truth_count
    return 1 if metric.pooling == "sum" else pairs.count


class CasePool:
    """Pools every method's windows."""

    def __init__(self, store: NumberStore) -> None:
        self._store = store
        self._methods: dict[str, _MethodPool] = {}
        self._windows = 0

    def add(self, pairs: Mapping[str, MethodPairs], scores: Mapping[str, list[Score]]) -> None:
        """Adds a window: its pixels by method, and what `score_method` says of them."""
        if not self._windows:
            self._methods = {method: _MethodPool(self._store) for method in pairs}
        self._windows += 1
        for method, pool in self._methods.items():
            pool.add(pairs[method], {score.metric: score.value for score in scores[method]})

    def scores(self) -> dict[str, list[Score]]:
        """By method: what `score_method` would say of all windows' pixels in one."""
        return {method: pool.scores() for method, pool in self._methods.items()}


class _MethodPool:
    """One method's windows, by region; regions that a window lacks are left out."""

    def __init__(self, store: NumberStore) -> None:
        self._store = store
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

    def scores(self) -> list[Score]:
        found = [score for region in self._regions for score in self._scores(region)]
        return [*found, *cause_scores(self._causes)]

    def _pool(self, region: str) -> Pool:
        metrics = {name: ALL_METRICS[name] for name in metrics_of(region)}
        return Pool(metrics, self._store)

    def _scores(self, region: str) -> Iterator[Score]:
        pool = self._regions[region]
        if region == ALL:
            yield from context_scores(pool.truth_points, pool.baseline_focal_px_m)
        for name, value in pool.values().items():
            metric = ALL_METRICS[name]
            score_name = full_name(name, region)
            yield Score(score_name, value, metric.unit, metric.direction, region, pool.points)
