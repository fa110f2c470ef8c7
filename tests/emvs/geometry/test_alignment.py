"""Alignment of points: a planted motion is found, and another derivation finds the same."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import naive_trajectories as naive
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.alignment import Similarity, align_points

seeds = st.integers(0, 10**6)


def planted(rng, scale):
    return Similarity(scale, Rotation.random(rng=rng).as_matrix(), rng.uniform(-100, 100, 3))


@given(seeds, st.integers(3, 40), st.floats(0.01, 100), st.booleans())
def test_a_planted_motion_is_recovered(seed, count, scale, with_scale):
    rng = np.random.default_rng(seed)
    points_b = rng.normal(size=(count, 3))
    motion = planted(rng, scale if with_scale else 1.0)
    found = align_points(motion.points(points_b), points_b, with_scale=with_scale)
    assert found.is_unique
    assert found.scale == pytest.approx(motion.scale, rel=1e-9)
    np.testing.assert_allclose(found.R_a_b, motion.R_a_b, atol=1e-7)
    np.testing.assert_allclose(found.points(points_b), motion.points(points_b), atol=1e-8)


@given(seeds, st.integers(3, 40), st.floats(0, 3), st.booleans())
def test_the_eigenvector_of_quaternions_finds_the_same(seed, count, noise, with_scale):
    """Even where noise is larger than the points: the best rotation may then be near a mirror."""
    rng = np.random.default_rng(seed)
    points_b = rng.normal(size=(count, 3))
    points_a = planted(rng, 2.0).points(points_b) + noise * rng.normal(size=(count, 3))
    found = align_points(points_a, points_b, with_scale=with_scale)
    scale, R, t = naive.horn(points_a, points_b, with_scale=with_scale)
    assert np.linalg.det(found.R_a_b) == pytest.approx(1)
    mine, theirs = (
        np.sum((points_a - moved) ** 2)
        for moved in (found.points(points_b), scale * points_b @ R.T + t)
    )
    assert mine == pytest.approx(theirs, rel=1e-9, abs=1e-18)


@given(seeds)
def test_no_nearby_motion_fits_better(seed):
    rng = np.random.default_rng(seed)
    points_a, points_b = rng.normal(size=(2, 12, 3))
    found = align_points(points_a, points_b, with_scale=True)
    least = np.sum((found.points(points_b) - points_a) ** 2)
    for _ in range(8):
        turn = Rotation.from_rotvec(0.01 * rng.normal(size=3)).as_matrix()
        other = Similarity(
            found.scale * (1 + 0.01 * rng.normal()), turn @ found.R_a_b,
            found.t_a_m + 0.01 * rng.normal(size=3),
        )  # fmt: skip
        assert np.sum((other.points(points_b) - points_a) ** 2) >= least - 1e-12


def test_points_on_a_line_leave_the_rotation_open():
    along = np.linspace(0, 1, 9)[:, None] * [1.0, 2.0, 3.0]
    found = align_points(along, along @ Rotation.from_euler("z", 1).as_matrix())
    assert not found.is_unique
    np.testing.assert_allclose(
        found.points(along @ Rotation.from_euler("z", 1).as_matrix()), along, atol=1e-12
    )


def test_points_in_one_place_are_laid_upon_each_other():
    found = align_points(np.ones((5, 3)), np.zeros((5, 3)), with_scale=True)
    assert (found.scale, found.is_unique) == (1, False)
    np.testing.assert_array_equal(found.R_a_b, np.eye(3))
    np.testing.assert_array_equal(found.points(np.zeros((5, 3))), np.ones((5, 3)))


def test_poses_turn_with_the_points_and_keep_their_axes():
    rng = np.random.default_rng(3)
    motion = planted(rng, 3.0)
    T_b_body = se3.from_rotation(Rotation.random(4, rng=rng), rng.normal(size=(4, 3)))
    T_a_body = motion.poses(T_b_body)
    np.testing.assert_allclose(T_a_body[:, :3, 3], motion.points(T_b_body[:, :3, 3]))
    assert all(map(se3.is_rigid, T_a_body))
    np.testing.assert_array_equal(Similarity.identity().poses(T_b_body), T_b_body)
