"""SE(3), trajectories and their text form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.poses import read_poses, write_tum
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from refusals import refused


def random_trajectory(n: int, seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    t_us = np.cumsum(rng.integers(1, 20_000, n)).astype(np.int64)
    return Trajectory(t_us, rng.normal(size=(n, 3)), Rotation.random(n, rng=rng).as_quat())


trajectories = st.builds(random_trajectory, st.integers(2, 12), st.integers(0, 10**6))


@given(trajectories)
def test_inverse_times_pose_is_identity(trajectory):
    T_world_body = trajectory.at(trajectory.t_us)
    product = se3.inverse(T_world_body) @ T_world_body
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(4), product.shape), atol=1e-12)


@given(trajectories)
def test_at_the_poses_are_the_poses(trajectory):
    given_poses = se3.from_quat_xyzw(trajectory.positions_m, trajectory.quats_xyzw)
    np.testing.assert_allclose(trajectory.at(trajectory.t_us), given_poses, atol=1e-12)


@given(trajectories, st.floats(0, 1))
def test_between_two_poses_rotation_and_position_go_evenly(trajectory, share):
    t0, t1 = trajectory.t_us[:2]
    t = t0 + round(share * (t1 - t0))
    share = (t - t0) / (t1 - t0)
    T0, T1, T = (trajectory.at(time) for time in (t0, t1, t))
    whole = Rotation.from_matrix(T0[:3, :3].T @ T1[:3, :3]).magnitude()
    part = Rotation.from_matrix(T0[:3, :3].T @ T[:3, :3]).magnitude()
    assert part == pytest.approx(share * whole, abs=1e-7)
    np.testing.assert_allclose(T[:3, 3], (1 - share) * T0[:3, 3] + share * T1[:3, 3], atol=1e-12)


@given(trajectories)
def test_moving_the_body_frame_there_and_back(trajectory):
    T_body_cam = se3.from_quat_xyzw(
        [0.1, -0.2, 0.3], Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_quat()
    )
    again = trajectory.times(T_body_cam).times(se3.inverse(T_body_cam))
    np.testing.assert_allclose(again.at(again.t_us), trajectory.at(trajectory.t_us), atol=1e-9)


@given(trajectories)
def test_quaternion_sign_does_not_matter(trajectory):
    signs = np.where(np.arange(len(trajectory)) % 2, -1.0, 1.0)[:, None]
    other = Trajectory(trajectory.t_us, trajectory.positions_m, signs * trajectory.quats_xyzw)
    t = np.linspace(*trajectory.span_us, 50).astype(np.int64)
    np.testing.assert_allclose(other.at(t), trajectory.at(t), atol=1e-9)


def test_outside_the_span_is_refused_with_the_distance():
    trajectory = Trajectory(
        np.array([1000, 2000]), np.zeros((2, 3)), np.tile([0.0, 0, 0, 1], (2, 1))
    )
    refused("5 µs before the first", trajectory.at, 995)
    refused("7 µs after the last", trajectory.at, [1500, 2007])
    assert trajectory.at(np.zeros(0, np.int64)).shape == (0, 4, 4)


def test_one_pose_covers_one_instant():
    trajectory = Trajectory(np.array([5]), np.ones((1, 3)), np.array([[0.0, 0, 0, 1]]))
    np.testing.assert_allclose(trajectory.at(5)[:3, 3], 1)


@pytest.mark.parametrize(("t_us", "position", "quat", "words"), [
    ([0, 1], [[0, 0, 0], [0, np.nan, 0]], [[0, 0, 0, 1]] * 2, "pose 1 is not finite"),
    ([0, 1], [[0, 0, 0]] * 2, [[0, 0, 0, 1], [0, 0, 0, 2]], "pose 1: quaternion of length 2"),
    ([1, 1], [[0, 0, 0]] * 2, [[0, 0, 0, 1]] * 2, "does not come after"),
    ([], np.zeros((0, 3)), np.zeros((0, 4)), "N >= 1"),
])  # fmt: skip
def test_impossible_poses_are_refused(t_us, position, quat, words):
    position, quat = np.array(position, float), np.array(quat, float)
    refused(words, Trajectory, np.array(t_us, np.int64), position, quat)


@given(trajectories)
def test_tum_text_round_trip(tmp_path, trajectory):
    write_tum(tmp_path / "poses.txt", trajectory)
    again = read_poses(tmp_path / "poses.txt")
    assert np.array_equal(again.t_us, trajectory.t_us)
    np.testing.assert_allclose(again.at(again.t_us), trajectory.at(trajectory.t_us), atol=1e-11)


@pytest.mark.parametrize(("data", "words"), [
    (b"", "no poses"), (b"# only a comment\n", "no poses"), (None, "No such file"),
    (b"0 0 0 0 0 0 1\n", "line 1: 7 numbers"), (b"0 0 0 0 0 0 0 1\n1 x 0 0 0 0 0 1\n", "line 2"),
    (b"nan 0 0 0 0 0 0 1\n", "needs a finite time"), (b"\xff\xfe\x00", "text"),
    (b"0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n", "does not come after"),
])  # fmt: skip
def test_damaged_text_is_refused(tmp_path, data, words):
    path = tmp_path / "poses.txt"
    if data is not None:
        path.write_bytes(data)
    refused(words, read_poses, path)


def test_real_trajectories_are_read(shared_data):
    paths = [*shared_data.rglob("*.tum.txt"), shared_data / "slider_depth" / "groundtruth.txt"]
    assert len(paths) > 4
    for path in paths:
        trajectory = read_poses(path)
        assert se3.is_rigid(trajectory.at(sum(trajectory.span_us) // 2)), path
