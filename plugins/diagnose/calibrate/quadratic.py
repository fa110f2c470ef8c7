"""The top of an objective near a point: a paraboloid, its summit, and the summit's uncertainty.

The estimate maximises the mean over windows of the logarithm of sharpness, an M-estimator. Its
uncertainty has two sources. Windows disagree: with the curvature A and the slopes g of single
windows the covariance is A^-1 cov(g) A^-1 / W (the sandwich; Huber 1967). And where sharpness falls
by less than `RIPPLE`, the top is too flat to locate: what all windows share, pixels, planes, the
sensor's lag, moves it by as much.

Where parameters trade off, an undetermined one must not make another look certain. So all are
estimated together, each with a prior that the calibration as given is right to within a spread,
weighted against the data as in ridge regression (the weight that minimises the error of a single
parameter). Determined parameters are not affected; undetermined ones keep their value and the
uncertainty of the prior, which passes on to the parameters that they trade off with.
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
RIPPLE = 5e-5
"""Of the logarithm of sharpness: smaller changes are not significant."""


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

    def estimate(self, spread: Floats, independent: float) -> Summit:
        """The summit, with the prior that (P,) 0 is right to within `spread` (1 sigma).

        So many of the windows are `independent`: they do not overlap.
        """
        # In units of the spreads: degrees and milliseconds do not compare
        values, vectors = np.linalg.eigh(-self.curvature * spread[:, None] * spread)
        bend = vectors * np.maximum(values, 0) @ vectors.T
        slopes = self.slopes * spread
        centred = slopes - slopes.mean(axis=0)
        scatter = centred.T @ centred / max(1, len(centred) - 1) / independent + 2 * RIPPLE * bend
        own = np.maximum(np.diag(bend), 1e-12)
        pull = np.maximum(np.diag(scatter) / own, 2 * RIPPLE)
        inverse = np.linalg.inv(bend + np.diag(pull))
        step = inverse @ (slopes.mean(axis=0) - pull * self.point / spread)
        covariance = inverse @ (scatter + np.diag(pull**2)) @ inverse
        return Summit(self.point + spread * step, covariance * spread[:, None] * spread)


@dataclass(frozen=True, eq=False)
class Summit:
    """Where a summit is, (P,), and its (P, P) covariance."""

    point: Floats
    covariance: Floats


def fit(function: Function, point: Floats, steps: Floats) -> Paraboloid:
    """Fits by differences: two evaluations per parameter and two per pair of them.

    Differences are symmetric, so that an uneven top does not look like a trade-off.
    """
    count = len(point)
    value = function(point)
    plus, minus = (
        np.array([function(point + sign * step) for step in np.diag(steps)]) for sign in (1, -1)
    )
    slopes = ((plus - minus) / (2 * steps[:, None])).T
    curvature = np.diag(((plus + minus - 2 * value) / steps[:, None] ** 2).mean(axis=1))
    for i, j in combinations(range(count), 2):
        both = np.zeros(count)
        both[[i, j]] = steps[[i, j]]
        along = function(point + both) + function(point - both) - 2 * value
        own = plus[i] + minus[i] + plus[j] + minus[j] - 4 * value
        curvature[i, j] = curvature[j, i] = (along - own).mean() / (2 * steps[i] * steps[j])
    return Paraboloid(point, slopes, curvature)


def evaluations(parameters: int) -> int:
    """How often one `fit` evaluates its function."""
    return 1 + 2 * parameters + parameters * (parameters - 1)


def climb(
    function: Function, point: Floats, steps: Floats, spread: Floats, independent: float,
    rounds: int = 6,
) -> Summit:  # fmt: skip
    """Goes from summit to summit until the step is small; one round goes no farther than `steps`.

    If it does not converge, the last step counts as uncertainty as well. `spread` and `independent`
    are those of `Paraboloid.estimate`.
    """
    for _ in range(rounds):
        top = fit(function, point, steps).estimate(spread, independent)
        step = top.point - point
        if (np.abs(step) < 0.2 * steps).all():
            return top
        # Each by itself: an undetermined one, which may go anywhere, must not hold back the others
        point = higher(function, point, np.clip(step, -steps, steps))
    return Summit(point, top.covariance + np.outer(step, step))


def higher(function: Function, point: Floats, step: Floats) -> Floats:
    """The point after the step, or a half or quarter of it, if no lower; else the point itself."""
    before = function(point).mean()
    for share in (1.0, 0.5, 0.25):
        if function(point + share * step).mean() >= before:
            return np.asarray(point + share * step)
    return point
