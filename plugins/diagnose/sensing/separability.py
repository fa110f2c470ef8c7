"""How well a simple classifier tells two sets of statistics apart: area under the ROC curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

Floats = NDArray[np.float64]
FOLDS = 5
_PENALTY, _STEPS = 1.0, 50


def area_under_curve(first: Floats, second: Floats) -> float:
    """Chance that a score of the second exceeds one of the first, ties counting half: 0 to 1."""
    ranks = rankdata(np.concatenate([first, second]))
    above = ranks[len(first) :].sum() - len(second) * (len(second) + 1) / 2
    return float(above / (len(first) * len(second)))


def logistic(features: Floats, second: NDArray[np.bool_]) -> Floats:
    """(F + 1,) weights of a logistic regression with a ridge penalty, the last the intercept.

    Both classes weigh the same, however many rows they have. Newton's method.
    """
    rows = np.concatenate([features, np.ones((len(features), 1))], 1)
    balance = np.where(second, 0.5 / max(second.sum(), 1), 0.5 / max((~second).sum(), 1))
    balance *= len(rows)
    penalty = np.full(rows.shape[1], _PENALTY)
    penalty[-1] = 1e-6
    weights = np.zeros(rows.shape[1])
    for _ in range(_STEPS):
        p = 1 / (1 + np.exp(-np.clip(rows @ weights, -30, 30)))
        gradient = rows.T @ (balance * (p - second)) + penalty * weights
        curvature = (rows * (balance * p * (1 - p))[:, None]).T @ rows + np.diag(penalty)
        step = np.linalg.solve(curvature, gradient)
        weights -= step
        if np.abs(step).max() < 1e-9:
            break
    return weights


def separability(
    first: Floats, second: Floats, windows: tuple[NDArray[np.int64], NDArray[np.int64]]
) -> float:
    """Cross-validated area under the ROC curve, 0.5 where nothing tells the two apart.

    Held out are whole stretches of time, of both at once, so that no classifier is asked about a
    window whose neighbours it has learnt.

    Args:
        first: (N, F) statistics of the one.
        second: (M, F) of the other.
        windows: the window of each row, (N,) and (M,), on a common count.
    """
    features = np.concatenate([first, second])
    is_second = np.arange(len(features)) >= len(first)
    window = np.concatenate(windows)
    fold = window * FOLDS // (int(window.max()) + 1)
    areas, weights = [], []
    for k in range(FOLDS):
        test, learn = fold == k, fold != k
        sides = [np.count_nonzero(test & (is_second == side)) for side in (False, True)]
        if min(sides) == 0 or len(np.unique(is_second[learn])) < 2:
            continue
        middle, scale = features[learn].mean(0), features[learn].std(0) + 1e-9
        found = logistic((features[learn] - middle) / scale, is_second[learn])
        score = ((features - middle) / scale) @ found[:-1]
        areas.append(area_under_curve(score[test & ~is_second], score[test & is_second]))
        weights.append(sides[0] * sides[1])
    return float(np.average(areas, weights=weights)) if areas else float("nan")
