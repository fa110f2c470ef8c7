"""A recording is perturbed by just what was asked for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.perturbations import (
    Perturbation,
    perturbed,
    perturbed_rig,
    perturbed_trajectory,
    thinned,
)
from point_world import fronto_parallel, pinhole, stereo_rig


def still(poses=4000, rate_hz=1000.0):
    t_us = (np.arange(poses) * 1e6 / rate_hz).astype(np.int64)
    return Trajectory(t_us, np.ones((poses, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (poses, 1)))


def walk(poses=2001, speed_m_s=1.0):
    t_us = np.arange(poses, dtype=np.int64) * 1000
    positions_m = np.zeros((poses, 3))
    positions_m[:, 1] = speed_m_s * t_us * 1e-6
    return Trajectory(t_us, positions_m, np.tile([0.0, 0.0, 0.0, 1.0], (poses, 1)))


def errors(poses, perturbed):
    """Position error in the body's frame, mm, and rotation error, deg."""
    T = se3.inverse(poses.at(poses.t_us)) @ perturbed.at(perturbed.t_us)
    return 1e3 * T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_rotvec(degrees=True)


def random_events(n=20_000, seed=0):
    rng = np.random.default_rng(seed)
    return Events(
        rng.integers(0, 346, n).astype(np.uint16), rng.integers(0, 260, n).astype(np.uint16),
        np.sort(rng.integers(0, 10**6, n)), rng.integers(0, 2, n).astype(np.uint8),
    )  # fmt: skip


def test_nothing_asked_for_is_nothing_perturbed():
    sound = fronto_parallel(2.0)
    spoilt = perturbed(sound, Perturbation(), 0)
    before, after = sound.trajectory, spoilt.trajectory
    np.testing.assert_array_equal(after.t_us, before.t_us)
    np.testing.assert_allclose(after.positions_m, before.positions_m, atol=1e-12)
    assert spoilt.rig.cameras == sound.rig.cameras
    np.testing.assert_allclose(spoilt.rig.T_body_cam, sound.rig.T_body_cam, atol=1e-15)
    np.testing.assert_array_equal(spoilt.events(0, 0, 10**6).t_us, sound.streams[0].t_us)


def test_white_noise_has_the_spread_that_was_asked_for_in_every_pose():
    amount = Perturbation(pose_white_mm=3, pose_white_deg=0.2)
    position_mm, rotation_deg = errors(still(), perturbed_trajectory(still(), amount, seed=1))
    assert position_mm.std(axis=0) == pytest.approx([3] * 3, rel=0.05)
    assert rotation_deg.std(axis=0) == pytest.approx([0.2] * 3, rel=0.05)
    assert abs(np.corrcoef(position_mm[1:, 0], position_mm[:-1, 0])[0, 1]) < 0.06


@pytest.mark.slow
def test_a_random_walk_spreads_with_the_square_root_of_time():
    amount = Perturbation(pose_walk_mm=2, pose_walk_deg=0.1)
    ends = [errors(still(401), perturbed_trajectory(still(401), amount, s)) for s in range(300)]
    for after, seconds in ((100, 0.1), (400, 0.4)):
        position_mm = np.array([position[after] for position, _ in ends])
        rotation_deg = np.array([rotation[after] for _, rotation in ends])
        assert position_mm.std() == pytest.approx(2 * np.sqrt(seconds), rel=0.1)
        assert rotation_deg.std() == pytest.approx(0.1 * np.sqrt(seconds), rel=0.1)
    assert all(np.abs(position[0]).max() < 1e-9 for position, _ in ends)


@given(st.floats(0.1, 5), st.integers(0, 100))
@settings(max_examples=20)
def test_a_larger_amount_is_the_same_error_enlarged(factor, seed):
    one, many = (
        perturbed_trajectory(walk(200), Perturbation(pose_white_mm=a, pose_walk_mm=a), seed)
        for a in (1, factor)
    )
    small, large = (errors(walk(200), perturbed)[0] for perturbed in (one, many))
    np.testing.assert_allclose(large, factor * small, atol=1e-9)


@pytest.mark.slow
def test_odometry_starts_right_turns_steadily_and_is_off_by_its_share_of_the_way():
    turned = perturbed_trajectory(walk(), Perturbation(drift_yaw_deg_s=2), 0)
    yaw = Rotation.from_quat(turned.quats_xyzw).as_rotvec(degrees=True)
    np.testing.assert_allclose(yaw[:, 2], 2 * walk().t_us / 1e6, atol=1e-9)
    long = [perturbed_trajectory(walk(1001), Perturbation(drift_percent=1), s) for s in range(200)]
    first_10_ms = np.array([one.positions_m[10, 1] / 0.010 - 1 for one in long])
    assert first_10_ms.std() == pytest.approx(0.01, rel=0.15)
    assert all(np.abs(one.positions_m[0]).max() == 0 for one in long)


@given(st.floats(5, 900), st.integers(2, 500))
def test_a_lower_rate_keeps_true_poses_at_that_rate_and_the_span(rate_hz, poses):
    sound = walk(poses)
    thin = perturbed_trajectory(sound, Perturbation(pose_rate_hz=rate_hz), 0)
    assert thin.span_us == sound.span_us
    assert set(thin.t_us) <= set(sound.t_us)
    steps_us = np.diff(thin.t_us)[:-1]
    assert np.all(np.abs(steps_us - 1e6 / rate_hz) <= 2000)
    np.testing.assert_allclose(thin.positions_m[:, 1], thin.t_us * 1e-6, atol=1e-9)


@given(st.floats(-50, 50))
def test_delays_shift_clocks_and_nothing_else(delay_ms):
    sound = fronto_parallel(2.0)
    spoilt = perturbed(sound, Perturbation(camera_delay_ms=delay_ms, pose_delay_ms=delay_ms), 0)
    shift_us = round(1e3 * delay_ms)
    events = spoilt.events(1, -(10**6), 2 * 10**6)
    np.testing.assert_array_equal(events.t_us, sound.streams[1].t_us + shift_us)
    np.testing.assert_array_equal(events.x, sound.streams[1].x)
    np.testing.assert_array_equal(spoilt.events(0, 0, 10**6).t_us, sound.streams[0].t_us)
    np.testing.assert_array_equal(spoilt.trajectory.t_us, sound.trajectory.t_us + shift_us)
    inside = spoilt.events(1, 200_000, 300_000).t_us
    assert np.all((inside >= 200_000) & (inside < 300_000))


def test_thinning_keeps_shares_nested_and_favours_nothing():
    events = random_events()
    for share in (0.1, 0.5, 0.9):
        assert len(thinned(events, share, 3)) / len(events) == pytest.approx(share, abs=0.015)
    few, many = (set(zip(*_columns(thinned(events, s, 3)), strict=True)) for s in (0.3, 0.6))
    assert few < many
    parts = [thinned(events.slice(k, k + 777), 0.4, 3) for k in range(0, len(events), 777)]
    whole = thinned(events, 0.4, 3)
    np.testing.assert_array_equal(Events.concat(parts).t_us, whole.t_us)
    assert set(thinned(events, 0.4, 3).t_us) != set(thinned(events, 0.4, 4).t_us)
    events = random_events(200_000)
    kept = thinned(events, 0.5, 0)
    for column in _columns(events):
        edges = np.quantile(column, np.linspace(0, 1, 9)) if len(set(column)) > 2 else [0, 1, 2]
        before, after = (np.histogram(c, edges)[0] for c in (column, kept_of(kept, events, column)))
        assert np.all(np.abs(after / before - 0.5) < 0.02)


def kept_of(kept, events, column):
    """The column of `kept` that `column` is of `events`."""
    pairs = zip(_columns(events), _columns(kept), strict=True)
    return next(after for before, after in pairs if before is column)


def _columns(events):
    return events.x, events.y, events.t_us, events.p


def test_errors_of_calibration_and_hand_eye_are_what_was_asked_for():
    rig = stereo_rig(pinhole(), 0.1)
    amounts = {"focal_percent": 1, "centre_px": 2, "stereo_yaw_deg": 0.5, "baseline_percent": -10}
    perturbed = perturbed_rig(rig, Perturbation(**amounts))
    assert perturbed.cameras[1].fx_px == pytest.approx(rig.cameras[1].fx_px * 1.01)
    assert perturbed.cameras[0].cx_px == rig.cameras[0].cx_px + 2
    assert perturbed.baseline_m() == pytest.approx(0.09)
    turn = Rotation.from_matrix(perturbed.T_body_cam[1][:3, :3]).as_rotvec(degrees=True)
    np.testing.assert_allclose(turn, [0, 0.5, 0], atol=1e-9)
    np.testing.assert_array_equal(perturbed.T_body_cam[0], rig.T_body_cam[0])
    sound = walk()
    told = perturbed_trajectory(sound, Perturbation(hand_eye_mm=20, hand_eye_deg=3), 5)
    offset_mm, turn_deg = errors(sound, told)
    np.testing.assert_allclose(np.linalg.norm(offset_mm, axis=1), 20, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(turn_deg, axis=1), 3, rtol=1e-6)
    np.testing.assert_allclose(offset_mm, offset_mm[:1].repeat(len(offset_mm), 0), atol=1e-6)
    other_mm, _ = errors(sound, perturbed_trajectory(sound, Perturbation(hand_eye_mm=20), 6))
    assert np.linalg.norm(other_mm[0] - offset_mm[0]) > 1


@pytest.mark.parametrize(
    "bad", [{"keep_events": 0}, {"pose_white_mm": -1}, {"unknown": 1}, {"focal_percent": np.inf}]
)
def test_impossible_amounts_are_refused(bad):
    with pytest.raises(ValidationError):
        Perturbation(**bad)


def test_cameras_that_are_swapped_show_each_others_events():
    sound = fronto_parallel(2.0)
    swapped = AlteredRecording(sound, streams=(1, 0), clock_us=(5, 0))
    np.testing.assert_array_equal(swapped.events(1, 0, 10**6).x, sound.events(0, 0, 10**6).x)
    late, there = swapped.events(0, 5, 10**6 + 5), sound.events(1, 0, 10**6)
    np.testing.assert_array_equal(late.t_us, there.t_us + 5)
    assert swapped.rig is sound.rig
    assert swapped.trajectory is sound.trajectory
