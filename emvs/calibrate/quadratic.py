"""The top of an objective near a point: a paraboloid, its summit, and how sure that summit is.

The estimate maximises the mean over windows of the logarithm of sharpness, an M-estimator. Two
things make it unsure. Windows disagree: from the curvature A and the slopes g of single windows
follows the covariance A^-1 cov(g) A^-1 / W (the sandwich; Huber 1967). And a top so flat that
sharpness falls by less than `RIPPLE` says nothing about what lies within: what all windows share,
pixels, planes, the sensor's lag, moves the top by as much. Both are added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Function = Callable[[Floats], Floats]
"""Takes (P,) parameters and gives (W,) values, one per window."""
RIPPLE = 5e-5
"""Of the logarithm of sharpness: a fall by so little is not seen."""


@dataclass(frozen=True, eq=False)
class Paraboloid:
    """A quadratic model of every window's values around a point.

    Attributes:
        point: (P,) where it was fitted.
        slopes: (W, P) first derivatives there.
        curvature: (P, P) mean second derivatives; negative definite below a summit.
    """

    point: Floats
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

    def covariance(self, independent: float) -> Floats:
        """(P, P) of the summit; infinite where the top is flat or not a top.

        Args:
            independent: how many windows do not overlap.
        """
        count = len(self.point)
        values = np.linalg.eigvalsh(self.curvature)
        if independent < 2 or values.max(initial=-np.inf) >= 0:
            return np.full((count, count), np.inf)
        inverse = np.linalg.inv(self.curvature)
        spread = self.slopes - self.slopes.mean(axis=0)
        scatter = spread.T @ spread / (len(spread) - 1) / independent
        return np.asarray(inverse @ scatter @ inverse - 2 * RIPPLE * inverse)

    def without(self, k: int, value: float) -> Paraboloid:
        """The model of the other parameters where parameter k has a value."""
        others = np.delete(np.arange(len(self.point)), k)
        moved = self.curvature[others, k] * (value - self.point[k])
        return Paraboloid(
            self.point[others],
            self.slopes[:, others] + moved,
            self.curvature[np.ix_(others, others)],
        )

    def moved(self, point: Floats) -> Paraboloid:
        """The same model told from another point."""
        slopes = self.slopes + self.curvature @ (point - self.point)
        return replace(self, point=point, slopes=slopes)


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
    curvature = np.diag(((plus + minus - 2 * value) / steps[:, None] ** 2).mean(axis=1))
    for i, j in combinations(range(count), 2):
        both = np.zeros(count)
        both[[i, j]] = steps[[i, j]]
        mixed = (function(point + both) - plus[i] - plus[j] + value).mean()
        curvature[i, j] = curvature[j, i] = mixed / (steps[i] * steps[j])
    return Paraboloid(point, slopes, curvature)


def evaluations(parameters: int) -> int:
    """How often one `fit` evaluates its function."""
    return 1 + 2 * parameters + parameters * (parameters - 1) // 2


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
        if (np.abs(summit - model.point) < 0.2 * steps).all():
            break
        model = fit(function, summit, steps)
    return model
