"""Paraboloids: their summits, what is flat, and how sure a summit is."""

import numpy as np
import pytest

from eventsweep.plugins.diagnose.calibrate import quadratic
from eventsweep.plugins.diagnose.calibrate.objective import peak_of
from eventsweep.plugins.diagnose.calibrate.quadratic import climb, evaluations, fit

BEND = np.array([[-2.0, 0.7, 0.1], [0.7, -1.5, -0.3], [0.1, -0.3, -0.8]])
TOP = np.array([0.3, -0.2, 0.5])
WIDE = np.full(3, 1e3)  # a belief that says next to nothing


def hill(point, tops=(TOP,)):
    return np.array([0.5 * (point - top) @ BEND @ (point - top) for top in tops])


def test_a_paraboloid_is_fitted_exactly_from_two_evaluations_per_parameter_and_per_pair():
    asked = []
    model = fit(lambda x: (asked.append(x), hill(x))[1], np.zeros(3), np.full(3, 0.1))
    assert np.allclose(model.curvature, BEND)
    assert np.allclose(model.estimate(WIDE, 1).point, TOP, atol=1e-6)
    assert len(asked) == 1 + 2 * 3 + 2 * 3 == evaluations(3)


def test_how_parameters_mix_is_seen_at_the_summit():
    """On a bent ridge: from where the climb began, the two seemed to trade off the other way."""

    def ridge(x):
        return np.array([-((x[0] - 1) ** 2) - 4 * (x[1] - x[0] ** 2) ** 2])

    top = climb(ridge, np.array([-0.5, 0.2]), np.full(2, 0.05), WIDE[:2], 1, rounds=60)
    at_top = fit(ridge, np.ones(2), np.full(2, 0.05)).estimate(WIDE[:2], 1)
    assert top.point == pytest.approx([1, 1], abs=0.05)
    assert np.allclose(top.covariance, at_top.covariance, rtol=0.3)


def test_climbing_reaches_a_summit_that_is_no_parabola_and_no_round_goes_farther_than_a_step():
    asked = []

    def cosh(x):
        asked.append(x)
        return -np.log(np.cosh(3 * (x - TOP))).sum(keepdims=True)

    top = climb(cosh, np.zeros(3), np.full(3, 0.1), WIDE, 1, rounds=8)
    assert np.allclose(top.point, TOP, atol=0.02)
    asked.clear()
    climb(cosh, np.zeros(3), np.full(3, 0.1), WIDE, 1, rounds=2)
    assert np.abs(asked).max() == pytest.approx(0.2)  # a step, and a difference around it


def test_a_climb_that_does_not_arrive_is_as_unsure_as_its_last_step():
    def far(x):
        return hill(x, (TOP + 10,))

    doubts = [
        np.sqrt(np.diag(climb(far, np.zeros(3), np.full(3, 0.1), WIDE, 1, rounds=n).covariance))
        for n in (3, 400)
    ]
    assert doubts[0].max() > 5
    assert doubts[1].max() < 0.5


def test_what_is_open_does_not_hold_back_what_is_determined():
    """The second climbs slowly without an end; the first has a summit, and must get there."""

    def slope(x):
        return np.array([-((x[0] - 1) ** 2) + 1e-3 * x[1]])

    top = climb(slope, np.zeros(2), np.full(2, 0.1), np.full(2, 1e3), 1, rounds=15)
    assert top.point[0] == pytest.approx(1, abs=0.02)
    assert abs(top.point[1]) < 2
    assert np.sqrt(top.covariance[1, 1]) > 10


def test_windows_that_disagree_make_a_summit_unsure_by_as_much(monkeypatch):
    """Without ripples the sandwich is the standard error of the windows' own summits."""
    monkeypatch.setattr(quadratic, "RIPPLE", 0.0)
    tops = TOP + np.random.default_rng(0).normal(0, 0.1, (12, 3))
    top = fit(lambda x: hill(x, tops), tops.mean(axis=0), np.full(3, 0.1)).estimate(WIDE, 12)
    assert np.allclose(top.point, tops.mean(axis=0), atol=1e-6)
    assert np.allclose(top.covariance, np.cov(tops.T) / 12, atol=1e-6)


def test_a_flat_top_is_unsure_even_where_windows_agree():
    doubts = []
    for height in (1.0, 0.01):
        model = fit(lambda x, h=height: h * hill(x, (TOP, TOP)), TOP, np.full(3, 0.1))
        doubts.append(np.sqrt(np.diag(model.estimate(WIDE, 2).covariance)))
    assert np.allclose(doubts[1], 10 * doubts[0], rtol=1e-3)


def test_where_nothing_is_seen_the_belief_remains():
    level = fit(lambda x: np.zeros(2), np.array([0.4, -0.1]), np.full(2, 0.1))
    top = level.estimate(np.array([2.0, 3.0]), 2)
    assert np.allclose(top.point, 0)
    assert np.allclose(np.sqrt(np.diag(top.covariance)), [2, 3])


def test_the_doubt_of_an_open_parameter_goes_to_what_it_trades_off_with():
    """Only a + b shows: neither is known better than the belief allows, their sum is."""
    model = fit(lambda x: np.full(3, -((x.sum() - 1.0) ** 2)), np.zeros(2), np.full(2, 0.1))
    top = model.estimate(np.full(2, 5.0), 3)
    assert top.point.sum() == pytest.approx(1, abs=1e-3)
    assert np.sqrt(np.diag(top.covariance)).min() > 2
    assert np.sqrt(top.covariance.sum()) < 0.05


def test_the_peak_of_a_scan_lies_between_its_points():
    at = np.linspace(-1, 1, 7)
    assert peak_of(at, -((at - 0.21) ** 2)) == pytest.approx(0.21)
    assert peak_of(at, at) == 1
