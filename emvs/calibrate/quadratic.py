"""The top of an objective near a point: a paraboloid, its summit, and how sure that summit is.

The estimate maximises the sum over windows of the logarithm of sharpness, an M-estimator. Its
covariance follows from the curvature A of the sum and from how the slopes g of single windows
scatter at the summit (the sandwich A^-1 (sum g g^T) A^-1; Huber 1967): windows that disagree make
it less sure, and so does a flat top.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Function = Callable[[Floats], Floats]
"""Takes (P,) parameters and gives (W,) values, one per window."""


@dataclass(frozen=True, eq=False)
class Paraboloid:
    """A quadratic model of every window's values around a point.

    Attributes:
        point: (P,) where it was fitted.
        value: (W,) there.
        slopes: (W, P) first derivatives there.
        curvature: (P, P) mean second derivatives; negative definite below a summit.
    """

    point: Floats
    value: Floats
    slopes: Floats
    curvature: Floats

    def summit(self, farthest: Floats) -> Floats:
        """(P,) the highest point within a box of +- `farthest` (P,) around the point.

        Where the model is not curved downwards the step follows the slope to the box's edge.
        """
        scaled = self.curvature * farthest[:, None] * farthest
        values, vectors = np.linalg.eigh(scaled)
        slope = vectors.T @ (self.slopes.mean(axis=0) * farthest)
        bend = np.maximum(-values, np.abs(slope))  # a step of 1 at most along each axis
        step = vectors @ np.divide(slope, bend, out=np.zeros_like(slope), where=bend > 0)
        longest = max(1.0, float(np.abs(step).max(initial=0)))
        return np.asarray(self.point + farthest * step / longest)

    def covariance(self) -> Floats:
        """(P, P) of the summit; infinite where the top is flat or not a top."""
        windows, count = self.slopes.shape
        values = np.linalg.eigvalsh(self.curvature)
        if windows < 2 or values.max(initial=-np.inf) >= 0:
            return np.full((count, count), np.inf)
        inverse = np.linalg.inv(self.curvature)
        spread = self.slopes - self.slopes.mean(axis=0)
        scatter = spread.T @ spread / (windows * (windows - 1))
        return np.asarray(inverse @ scatter @ inverse)


def fit(function: Function, point: Floats, steps: Floats) -> Paraboloid:
    """Fits by differences: two evaluations per parameter and one per pair of them.

    Args:
        function: what is to be modelled.
        point: (P,) centre.
        steps: (P,) how far from it the function is looked at.
    """
    count = len(point)
    value = function(point)
    plus, minus = (
        np.array([function(point + sign * one) for one in np.diag(steps)]) for sign in (1, -1)
    )
    slopes = ((plus - minus) / (2 * steps[:, None])).T
    bend = ((plus + minus - 2 * value) / steps[:, None] ** 2).mean(axis=1)
    curvature = np.diag(bend)
    for i, j in combinations(range(count), 2):
        both = function(point + _steps(steps, i, j))
        mixed = (both - plus[i] - plus[j] + value).mean() / (steps[i] * steps[j])
        # Of the corner that was looked at; half of each own curvature is in `plus` already
        curvature[i, j] = curvature[j, i] = mixed
    return Paraboloid(point, value, slopes, curvature)


def _steps(steps: Floats, i: int, j: int) -> Floats:
    moved = np.zeros_like(steps)
    moved[[i, j]] = steps[[i, j]]
    return moved


def climb(
    function: Function, point: Floats, steps: Floats, farthest: Floats, rounds: int = 3
) -> Paraboloid:
    """Goes from summit to summit until the step is small, and returns the last paraboloid.

    Args:
        function: what is to be maximised.
        point: (P,) where to begin.
        steps: (P,) for the differences.
        farthest: (P,) how far one round may go.
        rounds: of fitting, at most.
    """
    model = fit(function, point, steps)
    for _ in range(rounds - 1):
        summit = model.summit(farthest)
        if (np.abs(summit - model.point) < 0.15 * steps).all():
            break
        model = fit(function, summit, steps)
    return model
