"""The top of an objective near a point: a paraboloid, its summit, and how sure that summit is.

The estimate maximises the mean over windows of the logarithm of sharpness, an M-estimator. Two
things make it unsure. Windows disagree: with the curvature A and the slopes g of single windows
the covariance is A^-1 cov(g) A^-1 / W (the sandwich; Huber 1967). And a top so flat that sharpness
falls by less than `RIPPLE` says nothing about what lies within: what all windows share, pixels,
planes, the sensor's lag, moves the top by as much.

Where parameters trade off against each other, one that the data leave open must not make another
look sure. So all are estimated together, each with a belief that the calibration as given is right
to within a spread, weighted against the data as ridge regression does (the weight that makes the
error of a single parameter least). What is determined does not notice; what is open stays as given
and as unsure as the belief, and hands its doubt on to what it trades off with.
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

    def estimate(self, spread: Floats, independent: float) -> Estimated:
        """The summit, with the belief that (P,) 0 is right to within `spread` (1 sigma).

        Args:
            spread: (P,) of the belief.
            independent: how many windows do not overlap.
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
        return Estimated(self.point + spread * step, covariance * spread[:, None] * spread)


@dataclass(frozen=True, eq=False)
class Estimated:
    """A summit and how sure it is.

    Attributes:
        point: (P,) where it is.
        covariance: (P, P).
    """

    point: Floats
    covariance: Floats


def fit(function: Function, point: Floats, steps: Floats) -> Paraboloid:
    """Fits by differences: two evaluations per parameter and two per pair of them.

    Differences are symmetric, so that a top that falls off unevenly does not seem to trade off.

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
) -> Estimated:  # fmt: skip
    """Goes from summit to summit until the step is small.

    Where it does not arrive, it stays where it is, as unsure as the summit seemed far away.

    Args:
        function: what is to be maximised.
        point: (P,) where to begin.
        steps: (P,) for the differences; one round goes no farther.
        spread: (P,) of the belief that 0 is right.
        independent: how many windows do not overlap.
        rounds: of fitting, at most.
    """
    for _ in range(rounds):
        found = fit(function, point, steps).estimate(spread, independent)
        step = found.point - point
        if (np.abs(step) < 0.2 * steps).all():
            return found
        # One by one: what is open, and would go anywhere, must not hold back what is determined
        point = higher(function, point, np.clip(step, -steps, steps))
    return Estimated(point, found.covariance + np.outer(step, step))


def higher(function: Function, point: Floats, step: Floats) -> Floats:
    """The point after a step, or a shorter one, that does not lead downhill; else where it was."""
    before = function(point).mean()
    for share in (1.0, 0.5, 0.25):
        if function(point + share * step).mean() >= before:
            return np.asarray(point + share * step)
    return point
