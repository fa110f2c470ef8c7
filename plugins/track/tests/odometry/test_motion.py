"""What is expected of a motion: it does not depend on the unit of length."""

from dataclasses import replace

import numpy as np
import pytest

from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry.motion import Motion, reach_for


@pytest.mark.parametrize("begin", [Motion.unknown, Motion.near])
def test_a_world_that_is_larger_is_the_same_motion_in_other_units(begin):
    """All lengths 8 times as long: so are positions and velocities, and their errors."""
    units = np.diag(np.repeat([8.0, 1, 8, 1], 3))
    pose, twist = se3.exp([0.1, -0.2, 0.3, 0.4, 0.1, -0.3]), np.array([1, 2, -1, 0.5, 0.1, 2])
    longer = pose.copy()
    longer[:3, 3] *= 8
    small = replace(begin(0, pose), twist=twist).at(12_000)
    large = replace(begin(0, longer, 8.0), twist=units[:6, :6] @ twist).at(12_000)
    np.testing.assert_allclose(large.T_world_body[:3, 3], 8 * small.T_world_body[:3, 3])
    np.testing.assert_allclose(large.covariance, units @ small.covariance @ units, rtol=1e-9)
    assert large.held(13_000).reach == large.turning(np.zeros(3), 0.1).reach == 8


def test_what_a_later_motion_says_is_what_least_squares_over_both_say():
    """Both times are unknowns of one problem: what is known, how it moves on, a measured pose."""
    before = replace(Motion.near(0, se3.exp([0.1, 0, 0.2, 0, 0.3, 0])), twist=np.full(6, 0.2))
    expected, certain = before.at(10_000), replace(before, covariance=np.zeros((12, 12)))
    moved = certain.at(10_000).covariance  # what white acceleration adds
    step = se3.exp(before.twist * 0.01)
    F = np.block([
        [se3.adjoint(se3.inverse(step)), -0.01 * np.eye(6)], [np.zeros((6, 6)), np.eye(6)],
    ])  # fmt: skip
    measured, noise = 1e-5 * np.arange(1, 7), 1e-4 * np.eye(6)
    inverse, seen = np.linalg.inv, np.eye(6, 12)
    H = np.block([
        [inverse(before.covariance) + F.T @ inverse(moved) @ F, -F.T @ inverse(moved)],
        [-inverse(moved) @ F, inverse(moved) + seen.T @ inverse(noise) @ seen],
    ])  # fmt: skip
    both = np.linalg.solve(H, np.concatenate([np.zeros(12), seen.T @ inverse(noise) @ measured]))
    T_later = se3.inverse(se3.exp(both[12:18]) @ se3.inverse(expected.T_world_body))
    later = replace(
        expected, T_world_body=T_later, twist=expected.twist + both[18:],
        covariance=inverse(H)[12:, 12:],
    )  # fmt: skip
    smoothed = before.given(later)
    xi = se3.log(se3.inverse(smoothed.T_world_body) @ before.T_world_body)
    np.testing.assert_allclose(xi, both[:6], rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(smoothed.twist - before.twist, both[6:12], rtol=1e-3, atol=1e-8)
    np.testing.assert_allclose(smoothed.covariance, inverse(H)[:12, :12], rtol=1e-3, atol=1e-9)


def test_a_motion_surprises_by_chi_squared_of_its_twelve_unknowns():
    rng = np.random.default_rng(0)
    expected = replace(Motion.near(0, se3.exp([0.1, 0, 0.2, 0, 0.3, 0])), twist=np.full(6, 0.2))
    expected = replace(expected, covariance=1e-4 * expected.covariance)
    assert expected.surprise(expected) == pytest.approx(0)
    drawn = []
    for off in rng.multivariate_normal(np.zeros(12), expected.covariance, 2000):
        T_world_body = se3.inverse(se3.exp(off[:6]) @ se3.inverse(expected.T_world_body))
        found = replace(expected, T_world_body=T_world_body, twist=expected.twist + off[6:])
        drawn.append(found.surprise(expected))
    assert np.mean(drawn) == pytest.approx(12, abs=0.4)
    assert np.var(drawn) == pytest.approx(24, abs=3)


def test_a_motion_that_is_unsettled_keeps_its_place_and_surprises_by_no_turning_back():
    moving = replace(Motion.near(0, np.eye(4)), twist=np.array([1.0, 0, 0, 0, 0, 0]))
    moving = replace(moving, covariance=1e-4 * moving.covariance)
    back = replace(moving, twist=-moving.twist)
    assert back.surprise(moving) > 1000
    assert back.surprise(moving.unsettled()) < 12
    away = replace(moving, T_world_body=se3.exp([0.1, 0, 0, 0, 0, 0]))
    assert away.surprise(moving.unsettled()) > 1000


def test_heads_reach_as_far_as_they_do_and_cars_farther():
    assert reach_for(0.2) == reach_for(0.5) == 1
    assert reach_for(4.0) == 8
