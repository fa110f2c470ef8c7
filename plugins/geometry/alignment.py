"""Brings a geometry of another frame, or another scale, onto the true surfaces.

Its points have no counterparts, so the motion is found by iterated closest points in both
directions: from points of the geometry to the planes of the nearest true discs, and from true discs
to the nearest points. One direction alone would shrink the geometry into a single wall. It starts
where the geometry lies, and from its principal axes laid onto the truth's in all four ways.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry.alignment import Similarity
from eventsweep.plugins.geometry.nearest import Nearest
from eventsweep.plugins.geometry.surfels import Surfels

Points = NDArray[np.float64]
_COARSE, _FINE = 1_000, 20_000  # points per direction
_COARSE_STEPS, _FINE_STEPS = 25, 100
_SCALES = (0.8, 1.0, 1.25)
_STILL = 1e-10  # of scale, angle and share of the extent that a step changes


class _Pairs:
    """Draws points of both, and finds for each the nearest of the other."""

    def __init__(self, truth: Surfels, points: Points, count: int) -> None:
        rng = np.random.default_rng(0)
        chosen = [
            rng.choice(len(of), min(count, len(of)), replace=False)
            for of in (points, truth.points_world)
        ]
        self._truth, self._points = truth, points
        self._drawn, self._drawn_truth = points[chosen[0]], truth.points_world[chosen[1]]
        self._normals = truth.normals[chosen[1]].astype(np.float64)

    def search(self, to_truth: Nearest, to_points: Nearest, world_own: Similarity) -> tuple[
        Points, Points, Points, NDArray[np.float64]
    ]:  # fmt: skip
        """Places of the geometry, true places, their normals, distances in m; in the world."""
        moved = world_own.points(self._drawn)
        away_m, found = to_truth.query(moved)
        own = (self._drawn_truth - world_own.t_a_m) @ world_own.R_a_b / world_own.scale
        back_m, nearest = to_points.query(own)
        return (
            np.concatenate([moved, world_own.points(self._points[nearest])]),
            np.concatenate([self._truth.points_world[found], self._drawn_truth]),
            np.concatenate([self._truth.normals[found].astype(np.float64), self._normals]),
            np.concatenate([away_m, back_m * world_own.scale]),
        )


def align_to(truth: Surfels, points: Points, *, with_scale: bool) -> Similarity:
    """The motion, with a scale if asked, that lays (N, 3) points onto true surfaces best."""
    to_truth, to_points = Nearest(truth.points_world), Nearest(points)
    extent_m = spread_m(truth.points_world)
    coarse, fine = (_Pairs(truth, points, count) for count in (_COARSE, _FINE))

    def cost(pairs: _Pairs, motion: Similarity) -> float:
        *_, away_m = pairs.search(to_truth, to_points, motion)
        return float(np.minimum(away_m, extent_m / 10).mean())

    found = [
        _refined(coarse, to_truth, to_points, start, extent_m, _COARSE_STEPS, with_scale)
        for start in _starts(truth.points_world, points, with_scale)
    ]
    best = min(found, key=lambda motion: cost(coarse, motion))
    return _refined(fine, to_truth, to_points, best, extent_m, _FINE_STEPS, with_scale)


def spread_m(points: Points) -> float:
    """Median distance from the middle, m: outliers hardly change it."""
    # Axis by axis: ten million points are not copied at once.
    axes = ((axis - np.median(axis)) ** 2 for axis in points.T)
    return float(np.median(np.sqrt(sum(axes))))


def _starts(true: Points, points: Points, with_scale: bool) -> Iterator[Similarity]:
    yield Similarity.identity()
    middle, own = np.median(true, axis=0), np.median(points, axis=0)
    size = spread_m(true) / max(spread_m(points), 1e-12) if with_scale else 1.0
    axes, own_axes = _axes(true - middle), _axes(points - own)
    turns = [np.eye(3)]
    for x, y in product((1, -1), repeat=2):
        turn = axes @ np.diag([x, y, x * y]) @ own_axes.T
        turns.append(turn)
    for turn in turns:
        for factor in _SCALES if with_scale else (1.0,):
            scale = size * factor
            yield Similarity(scale, turn, middle - scale * turn @ own)


def _axes(centred: Points) -> Points:
    """(3, 3) principal axes in columns, right-handed."""
    _, axes = np.linalg.eigh(centred.T @ centred)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return np.asarray(axes, np.float64)


def _refined(
    pairs: _Pairs, to_truth: Nearest, to_points: Nearest, motion: Similarity, extent_m: float,
    steps: int, with_scale: bool,
) -> Similarity:  # fmt: skip
    """Gauss-Newton on distances from true planes, with the closest pairs of each step."""
    for _ in range(steps):
        own, true, normals, away_m = pairs.search(to_truth, to_points, motion)
        near = away_m <= max(3 * float(np.median(away_m)), 1e-9)
        own, true, normals = own[near], true[near], normals[near]
        middle = own.mean(axis=0)
        arm = own - middle
        columns = [np.cross(arm, normals), normals, np.sum(arm * normals, axis=1)[:, None]]
        system = np.hstack(columns if with_scale else columns[:2])
        off = np.sum((own - true) * normals, axis=1)
        step = np.linalg.lstsq(system, -off, rcond=1e-9)[0]
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        grown = float(np.exp(np.clip(step[6], -0.5, 0.5))) if with_scale else 1.0
        place = grown * turn @ (motion.t_a_m - middle) + middle + step[3:6]
        motion = Similarity(motion.scale * grown, turn @ motion.R_a_b, place)
        change = max(float(np.abs(step[:3]).max()), float(np.abs(step[3:6]).max()) / extent_m)
        if max(change, abs(grown - 1)) < _STILL:
            break
    return motion
