"""Paraboloids: their summits, what is flat, and how sure a summit is."""

import numpy as np
import pytest

from emvs.calibrate import quadratic
from emvs.calibrate.quadratic import climb, evaluations, fit
from emvs.calibrate.search import peak_of

BEND = np.array([[-2.0, 0.7, 0.1], [0.7, -1.5, -0.3], [0.1, -0.3, -0.8]])
TOP = np.array([0.3, -0.2, 0.5])


def hill(point, tops=(TOP,)):
    return np.array([0.5 * (point - top) @ BEND @ (point - top) for top in tops])


def test_a_paraboloid_is_fitted_exactly():
    model = fit(hill, np.zeros(3), np.full(3, 0.1))
    assert np.allclose(model.curvature, BEND)
    assert np.allclose(model.summit(np.full(3, 5.0)), TOP)


def test_a_fit_evaluates_as_often_as_it_says():
    asked = []
    fit(lambda x: (asked.append(x), hill(x))[1], np.zeros(3), np.full(3, 0.1))
    assert len(asked) == evaluations(3)


def test_climbing_reaches_a_summit_that_is_no_parabola():
    model = climb(lambda x: -np.abs(x - TOP).sum(keepdims=True) ** 1.5, np.zeros(3), np.full(3, 0.2),
                  np.full(3, 0.4), rounds=8)  # fmt: skip
    assert np.allclose(model.summit(np.full(3, 0.4)), TOP, atol=0.1)


def test_steps_stay_within_the_box_and_go_uphill_where_nothing_bends_down():
    model = fit(lambda x: np.array([x[0] + 0.1 * x[0] ** 2]), np.zeros(1), np.full(1, 0.1))
    assert model.summit(np.array([2.0])) == pytest.approx([2.0])


def test_windows_that_disagree_make_a_summit_unsure_by_as_much(monkeypatch):
    """Without ripples the sandwich is the standard error of the windows' own summits."""
    monkeypatch.setattr(quadratic, "RIPPLE", 0.0)
    tops = TOP + np.random.default_rng(0).normal(0, 0.1, (12, 3))
    model = fit(lambda x: hill(x, tops), tops.mean(axis=0), np.full(3, 0.1))
    assert np.allclose(model.summit(np.full(3, 1.0)), tops.mean(axis=0))
    assert np.allclose(model.covariance(12), np.cov(tops.T) / 12)


def test_a_flat_top_is_unsure_even_where_windows_agree():
    model = fit(lambda x: hill(x, (TOP, TOP)), TOP, np.full(3, 0.1))
    low = np.sqrt(np.diag(model.covariance(2)))
    flat = fit(lambda x: 0.01 * hill(x, (TOP, TOP)), TOP, np.full(3, 0.1))
    assert np.allclose(np.sqrt(np.diag(flat.covariance(2))), 10 * low)
    level = fit(lambda x: np.zeros(2), TOP, np.full(3, 0.1))
    assert np.isinf(level.covariance(2)).all()


def test_a_parameter_can_be_fixed():
    model = fit(hill, np.zeros(3), np.full(3, 0.1)).without(1, 0.4)
    others = [0, 2]
    left = BEND[np.ix_(others, others)]
    expected = TOP[others] - np.linalg.solve(left, BEND[others, 1]) * (0.4 - TOP[1])
    assert np.allclose(model.summit(np.full(2, 5.0)), expected)


def test_the_peak_of_a_scan_lies_between_its_points():
    at = np.linspace(-1, 1, 7)
    assert peak_of(at, -((at - 0.21) ** 2)) == pytest.approx(0.21)
    assert peak_of(at, at) == 1
