"""One geometry against true surfaces: distances both ways, and every number made of them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.alignment import Similarity
from eventsweep.eval.results.table import POOLED
from eventsweep.eval.scoring.method_scores import Score, full_name
from eventsweep.eval.scoring.metrics import (
    GEOMETRY_METRICS,
    WITHIN_CM,
    WITHIN_PERCENT,
)
from eventsweep.eval.scoring.trajectories.metrics import TRAJECTORY_METRICS
from eventsweep.plugins.geometry.alignment import align_to, spread_m
from eventsweep.plugins.geometry.nearest import Nearest, along_curve
from eventsweep.plugins.geometry.surfels import KINDS, Surfels, ordered
from eventsweep.plugins.geometry.truth import SEEN

Align = Literal["none", "se3", "sim3"]
Floats = NDArray[np.float64]
NAN = float("nan")
OTHER_UNIT = 30.0
"""A geometry this many times larger than the truth is in another unit."""
_FARTHEST_M = max(WITHIN_CM) / 100
_DOUBTFUL = 0.5  # of an aligned geometry's points within the largest distance


@dataclass(frozen=True, eq=False)
class GeometryScore:
    """Distances of one geometry and true surfaces, and what they were measured with.

    Attributes:
        points: (N, 3) the geometry's points in the world, aligned and in another order, m.
        to_truth_m: (N,) distance of each from the nearest true disc, m.
        nearest: (N,) number of that disc.
        to_points_m: (T,) distance of each true point from the geometry's nearest point, m.
        world_own: what aligned the geometry.
        notes: what a reader of the numbers must know.
    """

    points: Floats
    to_truth_m: Floats
    nearest: NDArray[np.integer[Any]]
    to_points_m: Floats
    world_own: Similarity
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Region:
    """Distances of a part of the surfaces: of points that lie nearest to it, and of its own."""

    name: str
    a_m: Floats
    c_m: Floats
    a_depth_m: NDArray[np.float32]
    c_depth_m: NDArray[np.float32]


class Judge:
    """Holds true surfaces, and scores any number of geometries against them.

    Attributes:
        truth: the surfaces, in the order of a space-filling curve.

    Args:
        truth: the surfaces, in any order; at least one.
    """

    def __init__(self, truth: Surfels) -> None:
        self.truth = ordered(truth)
        columns = self.truth.points_world, self.truth.normals, self.truth.radius_m
        self._discs = Nearest(*columns, is_ordered=True)

    def score(self, points: Floats, align: Align = "none") -> GeometryScore:
        """Measures the distances of (N, 3) points, m, from the surfaces, and the other way round.

        Args:
            points: in the world of the truth, or to be aligned; finite, at least one.
            align: `none`; `se3`, a rigid motion; `sim3`, also a scale.

        Raises:
            InputError: without an alignment, nothing of the geometry lies near what was seen, or
                it is in another unit.
        """
        motion = Similarity.identity()
        if align != "none":
            motion = align_to(self.truth, points, with_scale=align == "sim3")
            points = motion.points(points)
        self._check_place(points, align)
        points = points[along_curve(points)]
        a_m, found = self._discs.query(points, is_ordered=True)
        own = Nearest(points, is_ordered=True)
        c_m, _ = own.query(self.truth.points_world, is_ordered=True)
        return GeometryScore(points, a_m, found, c_m, motion, tuple(_notes(a_m, motion, align)))

    def _check_place(self, points: Floats, align: Align) -> None:
        true = self.truth.points_world
        size_m, true_size_m = spread_m(points), spread_m(true)
        if align != "sim3" and size_m > OTHER_UNIT * true_size_m:
            raise InputError(
                f"half of its points lie {size_m:.3g} m or more from their middle, of what the "
                f"cameras saw {true_size_m:.3g} m: is it in another unit? give metres, or set "
                "align to 'sim3'"
            )
        low, high = true.min(axis=0) - _FARTHEST_M, true.max(axis=0) + _FARTHEST_M
        if not ((points >= low) & (points <= high)).all(axis=1).any():
            raise InputError(
                f"no point lies where the truth is: the geometry spans {_box(points)}, what the "
                f"cameras saw {_box(true)}: give it in the sequence's world and metres, or "
                f"{_cure(align)}"
            )

    def scores(self, found: GeometryScore, align: Align = "none") -> Iterator[Score]:
        """Every number, of all surfaces and of each class, as rows of a table have them."""
        for region in self._regions(found):
            for name, value, support in _values(region):
                metric = GEOMETRY_METRICS[name]
                full = full_name(name, region.name)
                yield Score(full, value, metric.unit, metric.direction, region.name, support)
        if align == "sim3":
            metric = TRAJECTORY_METRICS["scale"]
            yield Score(metric.name, found.world_own.scale, metric.unit, metric.direction)

    def _regions(self, found: GeometryScore) -> Iterator[_Region]:
        truth, near = self.truth, found.nearest
        own_depth, depth = truth.depth_m[near], truth.depth_m
        yield _Region("all", found.to_truth_m, found.to_points_m, own_depth, depth)
        for name, chosen in classes(truth).items():
            of = chosen[near]
            yield _Region(
                name, found.to_truth_m[of], found.to_points_m[chosen], own_depth[of], depth[chosen]
            )


def classes(truth: Surfels) -> dict[str, NDArray[np.bool_]]:
    """(T,) masks of the true points of each class, then by how many views saw them."""
    kinds = {name: truth.kind == k for k, name in enumerate(KINDS)}
    seen = {
        name: (truth.views >= least) & (truth.views <= (most or np.inf))
        for name, least, most in SEEN
    }
    return kinds | seen


def _values(region: _Region) -> Iterator[tuple[str, float, int]]:
    a_m, c_m = region.a_m, region.c_m
    accuracy, completion = _mean(a_m), _mean(c_m)
    yield "accuracy", accuracy, len(a_m)
    yield "accuracy_median", _median(a_m), len(a_m)
    yield "completion", completion, len(c_m)
    yield "completion_median", _median(c_m), len(c_m)
    yield "chamfer", (accuracy + completion) / 2, len(a_m) + len(c_m)
    for name, for_a, for_c in _limits_m(region):
        precision, recall = 100 * _mean(a_m < for_a), 100 * _mean(c_m < for_c)
        yield f"surface_precision_{name}", precision, len(a_m)
        yield f"surface_recall_{name}", recall, len(c_m)
        yield f"surface_f1_{name}", f1(precision, recall), len(a_m) + len(c_m)


def _limits_m(region: _Region) -> Iterator[tuple[str, Any, Any]]:
    """Name and both limits, one after the other: those of the depth are as many as the points."""
    yield from ((f"{cm}cm", cm / 100, cm / 100) for cm in WITHIN_CM)
    for percent in WITHIN_PERCENT:
        a_m, c_m = region.a_depth_m, region.c_depth_m
        yield f"{percent}pct", _share_m(percent, a_m), _share_m(percent, c_m)


def _share_m(percent: float, depth_m: NDArray[np.float32]) -> Floats:
    return np.multiply(percent / 100, depth_m, dtype=np.float64)


def f1(precision: float, recall: float) -> float:
    """The harmonic mean; 0 where both are."""
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _mean(values: NDArray[Any]) -> float:
    return float(np.mean(values)) if len(values) else NAN


def _median(values: Floats) -> float:
    return float(np.median(values)) if len(values) else NAN


def _box(points: Floats) -> str:
    ends = zip(points.min(axis=0), points.max(axis=0), strict=True)
    axes = (f"{axis} {a:.3g} to {b:.3g}" for axis, (a, b) in zip("xyz", ends, strict=True))
    return f"{', '.join(axes)} m"


def _cure(align: Align) -> str:
    return "check the file" if align == "sim3" else "set align to 'sim3'"


def _notes(a_m: Floats, motion: Similarity, align: Align) -> Iterator[str]:
    near = float(np.mean(a_m < _FARTHEST_M))
    if align == "sim3":
        yield (
            f"aligned with a scale of {motion.scale:.6g}: the geometry was {1 / motion.scale:.6g} "
            "times as large as the truth"
        )
    if near < _DOUBTFUL:
        what = "the alignment is doubtful" if align != "none" else "is it in the truth's frame?"
        yield f"{100 * near:.0f} % of its points lie within 10 cm of a true surface: {what}"


@cache
def metric_versions() -> Mapping[str, str]:
    """What each metric makes of fixed surfaces, as a hash: it changes with its meaning."""
    row, column = (grid.ravel() / 50 for grid in np.mgrid[:24, :24])
    number = np.arange(len(row))
    wave = np.round(np.sin(7 * row) * 64) / 2048
    normals = np.tile(np.array([0, 0, 1], np.float32), (len(row), 1))
    radius, depth = (np.full(len(row), value, np.float32) for value in (0.015, 2.0))
    kind, views = (number % len(KINDS)).astype(np.uint8), (number % 12 + 1).astype(np.int32)
    truth = Surfels(np.column_stack([row, column, wave]), normals, radius, depth, kind, views)
    points = truth.points_world[::2] + np.column_stack([wave, wave, number % 11 / 512])[::2]
    judge = Judge(truth)
    texts = {
        score.metric: f"{score.value:.6g} {score.unit} {score.direction}"
        for score in judge.scores(judge.score(points))
    }
    return {name: hashlib.sha256(text.encode()).hexdigest()[:12] for name, text in texts.items()}


def rows_of(case: str, method: str, scores: Iterator[Score]) -> Iterator[dict[str, Any]]:
    """Scores as rows of a table."""
    for score in scores:
        yield {"case": case, "window": POOLED, "method": method, **score._asdict()}
