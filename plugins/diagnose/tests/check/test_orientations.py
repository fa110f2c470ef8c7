"""Poses whose orientations were misread are what they were once they are read rightly."""

from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose.check.orientations import axes_words, rereadings, signed_axes

T_S = np.linspace(0, 2, 400)
# From no rotation on, about all axes, as a tracker states a head's.
ANGLES = np.stack([0.5 * np.sin(2 * T_S), 0.4 * np.sin(3 * T_S), -0.3 * np.sin(2.5 * T_S)], axis=1)
POSITIONS_M = np.stack([np.sin(T_S), 0.3 * T_S, np.cos(2 * T_S)], axis=1)
MIRROR = np.diag([1.0, -1.0, 1.0])


def trajectory(turns, positions_m=POSITIONS_M):
    return Trajectory((1e6 * T_S).astype(np.int64), positions_m, turns.as_quat())


def motion(poses):
    """Each pose seen from the first: what does not depend on the world's axes."""
    T = poses.at(poses.t_us)
    return np.linalg.inv(T[0]) @ T


TRUE = trajectory(Rotation.from_euler("ZYX", ANGLES))


def assert_same_motion(name, misread):
    assert np.abs(motion(misread) - motion(TRUE)).max() > 0.05
    reread = next(change for other, change, _ in rereadings(misread) if other == name)
    np.testing.assert_allclose(motion(reread(misread)), motion(TRUE), atol=1e-9)


@pytest.mark.parametrize("right_handed", [True, False])
def test_axes_are_all_24(right_handed):
    axes = signed_axes(right_handed=right_handed)
    assert len({R.tobytes() for R in axes}) == 24
    for R in axes:
        assert np.array_equal(R @ R.T, np.eye(3))
        assert np.linalg.det(R) == (1 if right_handed else -1)


@pytest.mark.parametrize("R_given_body", signed_axes(right_handed=False), ids=str)
def test_left_handed_poses_of_any_body_axes(R_given_body):
    R = MIRROR @ Rotation.from_quat(TRUE.quats_xyzw).as_matrix() @ R_given_body.T
    name = f"left-handed poses, axes {axes_words(R_given_body.T)}"
    assert_same_motion(name, trajectory(Rotation.from_matrix(R), POSITIONS_M @ MIRROR))


@pytest.mark.parametrize("signs", sorted({*permutations((-1, 1, 1)), *permutations((-1, -1, 1))}))
def test_negated_axes_of_the_positions(signs):
    misread = Trajectory(TRUE.t_us, POSITIONS_M * signs, TRUE.quats_xyzw)
    which = " and ".join(axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0)
    assert_same_motion(f"{which} of the positions negated", misread)


@pytest.mark.parametrize(("order", "other"), [("xyz", "zyx"), ("zxy", "xzy"), ("yxz", "xyz")])
def test_euler_angles_in_another_order(order, other):
    angles = Rotation.from_quat(TRUE.quats_xyzw).as_euler(order)
    by_axis = dict(zip(order, angles.T, strict=True))
    misread = Rotation.from_euler(other, np.stack([by_axis[axis] for axis in other], axis=1))
    assert_same_motion(f"Euler angles {order} read as {other}", trajectory(misread))


@pytest.mark.parametrize("order", ["xyz", "zyx", "yxz"])
def test_radians_read_as_degrees_and_degrees_read_as_radians(order):
    angles = Rotation.from_quat(TRUE.quats_xyzw).as_euler(order)
    small = trajectory(Rotation.from_euler(order, angles, degrees=True))
    assert_same_motion(f"Euler angles {order} in radians read as degrees", small)
    large = trajectory(Rotation.from_euler(order, np.degrees(angles)))
    assert_same_motion(f"Euler angles {order} in degrees read as radians", large)
