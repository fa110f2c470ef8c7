"""Outliers that lie beside a depth edge, and those that are wrong wherever one looks.

A point on an occluding contour is right for one side of it and off by the whole step for the other,
and contours are where events are. Exact truth counts such a point as an outlier if it is half a
pixel beside the contour. So outliers are counted again with each point held against the truth of
its own pixel and of the eight around it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift

from eventsweep.eval.scoring.metrics import OUTLIER_RELATIVE_ERROR
from eventsweep.plugins.paper.evidence import Evidence, View

_AROUND = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1)]


def relative_errors(view: View, method: str) -> NDArray[np.float64]:
    """(N,) relative errors of a method's points, at their own pixel."""
    one, both = view.maps[method], view.maps[method].mask & view.truth.scored
    truth_m = view.truth.depth_m[both]
    return np.abs(one.depth_m[both] - truth_m) / truth_m


def tolerant_errors(view: View, method: str) -> NDArray[np.float64]:
    """(N,) the same, each against the truth within a pixel that is nearest to it."""
    one, both = view.maps[method], view.maps[method].mask & view.truth.scored
    truth_m = np.where(view.truth.scored, view.truth.depth_m, np.nan).astype(np.float64)
    near = [shift(truth_m, by, order=0, cval=np.nan)[both] for by in _AROUND]
    errors = [np.abs(one.depth_m[both] - there) / there for there in near]
    return np.asarray(np.fmin.reduce(errors), np.float64)


def outliers(errors: NDArray[np.float64]) -> float:
    """Share of errors above a tenth, %."""
    return 100 * float(np.mean(errors > OUTLIER_RELATIVE_ERROR))


def outliers_of(evidence: Evidence, case: str, method: str) -> tuple[float, float]:
    """Outliers of a case's first seed, and those that no truth within a pixel explains, %."""
    view = evidence.view(case)
    return outliers(relative_errors(view, method)), outliers(tolerant_errors(view, method))
