"""Head generators: smooth, seeded, any length, placed level, on their way, and as published."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry import se3
from eventsweep.sim.motion.curves import curve_of, look_at, moved, sampled
from eventsweep.sim.motion.head_motion import (
    along,
    gaze_shifts,
    generate,
    minimum_jerk,
    placed,
    run,
    seated,
    shake,
    walk,
    way_along,
)
from eventsweep.sim.motion.head_styles import STYLES
from motion_statistics import statistics
from refusals import refused

NAMES = list(STYLES)
T_REST = look_at((0, 0, 0), (1, 0, 0))


@pytest.mark.parametrize("name", NAMES)
def test_second_derivatives_are_continuous_and_bounded(name):
    """Numerical accelerations agree with the curve's own, and do not jump between samples."""
    motion, step_s = generate(name, 6.0, 3), 1e-3
    t_s = np.arange(0.1, 5.9, step_s)
    position = motion.poses(t_s)[:, :3, 3]
    numerical = np.diff(position, 2, axis=0) / step_s**2
    moving = motion.kinematics(t_s)
    np.testing.assert_allclose(numerical, moving.acceleration_m_s2[1:-1], atol=0.02)
    assert np.linalg.norm(numerical, axis=1).max() < 40
    assert np.abs(np.diff(numerical, axis=0)).max() < 0.5
    turning = moving.angular_acceleration_rad_s2
    assert np.linalg.norm(turning, axis=1).max() < 250
    assert np.abs(np.diff(turning, axis=0)).max() < 8


@pytest.mark.parametrize("name", NAMES)
def test_rotation_rate_is_the_derivative_of_the_rotation(name):
    motion, step_s = generate(name, 4.0, 1), 1e-4
    for t_s in (0.5, 1.7, 3.1):
        before, after = (
            Rotation.from_matrix(motion.T_world_body(t)[:3, :3])
            for t in (t_s - step_s, t_s + step_s)
        )
        numerical = (before.inv() * after).as_rotvec() / (2 * step_s)
        exact = motion.kinematics([t_s]).angular_velocity_rad_s[0]
        np.testing.assert_allclose(exact, numerical, atol=2e-4)
        early, late = motion.kinematics([t_s - step_s, t_s + step_s]).angular_velocity_rad_s
        np.testing.assert_allclose(
            motion.kinematics([t_s]).angular_acceleration_rad_s2[0],
            (late - early) / (2 * step_s),
            atol=2e-2,
        )


@pytest.mark.parametrize("name", NAMES)
def test_same_seed_same_motion_other_seed_another(name):
    t_s = np.linspace(0, 2, 20)
    assert np.array_equal(generate(name, 2, 5).poses(t_s), generate(name, 2, 5).poses(t_s))
    assert not np.allclose(generate(name, 2, 5).poses(t_s), generate(name, 2, 6).poses(t_s))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("duration_s", [0.003, 0.5, 37.123])
def test_any_duration_and_longer_ones_continue_shorter_ones(name, duration_s):
    motion, longer = generate(name, duration_s, 2), generate(name, 2 * duration_s, 2)
    t_s = np.linspace(0, duration_s, 11)
    assert all(se3.is_rigid(motion.T_world_body(float(t)), 1e-9) for t in t_s)
    np.testing.assert_allclose(motion.poses(t_s), longer.poses(t_s), atol=1e-3)
    refused("make the motion longer", motion.T_world_body, duration_s + 1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_one_pose_is_as_many_poses(name):
    motion, t_s = generate(name, 2, 0), np.linspace(0, 2, 7)
    one_by_one = np.stack([motion.T_world_body(float(t)) for t in t_s])
    np.testing.assert_allclose(motion.poses(t_s), one_by_one, atol=1e-12)
    np.testing.assert_allclose(sampled(motion, 2, 3).at(2_000_000), one_by_one[-1], atol=1e-9)


def test_gait_has_the_asked_frequency_speed_and_bob():
    plain = {"gaze_hz": 0.0, "unevenness": 0.0, "drift_m": (0, 0, 0), "impact": 0.0}
    for generator, step_hz, speed, bob_m in ((walk, 2.0, 1.4, 0.045), (run, 2.8, 3.0, 0.08)):
        motion = generator(40, 1, **plain)
        t_s = np.linspace(0, 40, 8001)
        position = motion.poses(t_s)[:, :3, 3]
        spectrum = np.abs(np.fft.rfft(position[:-1, 2]))
        assert np.argmax(spectrum) / 40 == pytest.approx(step_hz, abs=0.03)
        assert np.ptp(position[:, 2]) == pytest.approx(bob_m, rel=0.02)
        assert position[-1, 0] == pytest.approx(40 * speed, rel=0.03)


def test_the_head_pitches_against_the_bob():
    motion = walk(20, 0, gaze_hz=0.0, drift_deg=(0, 0, 0), drift_m=(0, 0, 0))
    poses = motion.poses(np.linspace(0, 20, 2000))
    up, looks_up = poses[:, 2, 3], poses[:, 2, 2]
    assert np.corrcoef(up, looks_up)[0, 1] < -0.9


def test_published_head_velocities_are_met():
    """Below 90 deg/s in gait without gaze shifts, and up to hundreds in a vigorous shake."""
    for generator in (walk, run):
        rate = statistics(generator(30, 0, gaze_hz=0.0), 30).rate_rad_s
        assert np.degrees(rate.maximum) < 90
    assert 200 < np.degrees(statistics(shake(30, 0), 30).rate_rad_s.maximum) < 900
    assert 1.4 <= statistics(shake(30, 0), 30).rate_hz <= 2.6


def test_gaze_shifts_are_minimum_jerk():
    share = np.linspace(0, 1, 1001)
    profile = minimum_jerk(share)
    assert (profile[0], profile[-1]) == (0, 1)
    assert np.gradient(profile, share).max() == pytest.approx(1.875, abs=1e-3)
    assert abs(np.gradient(np.gradient(profile, share), share)[[2, -3]]).max() < 0.2


def test_fixations_last_as_long_on_average_as_their_rate_says():
    """With turns that take no time, 2000 s have 2000 of them, within 4 standard deviations."""
    t_s = np.arange(0, 2000, 0.05)
    angles = gaze_shifts(t_s, np.random.default_rng(5), 1.0, np.array([0.1, 0.1]), 1e-6, 0.0)
    turns = int(np.count_nonzero(np.abs(np.diff(angles, axis=0)).max(axis=1) > 0))
    assert abs(turns - 2000) < 4 * (2 / 3) * np.sqrt(2000)


def test_seated_heads_rest_between_gaze_shifts():
    rate = statistics(seated(60, 0), 60).rate_rad_s
    assert rate.median < 0.2 < 0.8 < rate.maximum


def test_a_placed_head_looks_where_it_was_put_and_walks_level():
    start = look_at((2, 1, 1.7), (6, 3, 0.5))
    lengths = ("bob_m", "sway_m", "surge_m", "pitch_deg", "yaw_deg", "roll_deg", "gaze_hz")
    calm = dict.fromkeys(lengths, 0.0) | {"drift_deg": (0, 0, 0), "drift_m": (0, 0, 0)}
    motion = placed(walk(5, 0, **calm), start)
    np.testing.assert_allclose(motion.T_world_body(0), start, atol=1e-6)
    end = motion.T_world_body(5)
    np.testing.assert_allclose(end[:3, :3], start[:3, :3], atol=1e-6)
    assert end[2, 3] == pytest.approx(1.7, abs=1e-6)
    way = end[:2, 3] - start[:2, 3]
    np.testing.assert_allclose(way / np.linalg.norm(way), np.array([4, 2]) / np.sqrt(20), atol=1e-6)
    refused("cannot look", placed, walk(1, 0), look_at((0, 0, 2), (0, 0, 0), up=(0, 1, 0)))


def test_moved_is_a_product_of_poses():
    motion, left = walk(2, 0), look_at((1, 2, 3), (2, 4, 3))
    right = np.eye(4)
    right[:3, :3] = Rotation.from_rotvec([0.1, 0.5, -0.2]).as_matrix()
    for t_s in (0.0, 1.3):
        np.testing.assert_allclose(
            moved(motion, left, right).T_world_body(t_s),
            left @ motion.T_world_body(t_s) @ right,
            atol=1e-12,
        )


def test_a_walk_follows_the_street():
    points = np.array([(1.0, 0, 1.7), (9, 0, 1.7), (9, 12, 1.7), (20, 12, 1.7)])
    start, path = along(points)
    motion = placed(walk(20, 0, path_m=path, gaze_hz=0.0), start)
    poses = motion.poses(np.linspace(0, 20, 400))
    eyes = poses[:, :2, 3]
    legs = [
        np.linalg.norm(eyes[:, None] - np.linspace(a, b, 200)[None, :, :2], axis=2).min(axis=1)
        for a, b in pairwise(points)
    ]
    assert np.min(legs, axis=0).max() < 0.5
    halfway = poses[np.argmin(np.linalg.norm(eyes - (9, 6), axis=1))]
    assert halfway[1, 2] > 0.97
    assert poses[-1, 0, 2] > 0.97


@pytest.mark.parametrize("corner_s", [0.5, 1.2])
def test_a_corner_is_rounded_over_the_time_that_is_asked_for(corner_s):
    """Law: a window of that length sees both legs for as long, and one of them before and after."""
    t_s, path_m = np.arange(0, 6, 0.01), np.array([(0.0, 0), (3, 0), (3, 9)])
    _, heading = way_along(t_s, np.random.default_rng(0), 1.0, path_m, corner_s)
    turning = (heading > 1e-9) & (heading < np.pi / 2 - 1e-9)
    assert np.ptp(t_s[turning]) == pytest.approx(corner_s, abs=0.02)
    assert t_s[turning].mean() == pytest.approx(3, abs=0.2)


@pytest.mark.parametrize(("name", "duration_s", "parameters"), [
    ("crawl", 1, {}), ("walk", 0, {}), ("walk", -1, {}), ("walk", float("nan"), {}),
    ("walk", 1, {"speed": 2}), ("walk", 1, {"bob_m": -0.1}), ("walk", 1, {"step_hz": 9.0}),
    ("walk", 1, {"gaze_hz": float("inf")}), ("bike", 1, {"vibration_hz": (5.0, 60.0)}),
    ("bike", 1, {"drift_hz": (0.5, 0.1)}), ("run", 1, {"path_m": ((0, 0),)}),
    ("run", 1, {"path_m": ((0, 0), (1, 0), (0, 0))}),
    ("run", 1, {"path_m": ((0, 0), (0, 0))}), ("run", 1, {"path_m": ((0, 0), (np.nan, 0))}),
])  # fmt: skip
def test_impossible_heads_are_refused(name, duration_s, parameters):
    refused("", generate, name, duration_s, 0, **parameters)


def test_curve_of_another_motion_meets_it():
    from eventsweep.sim.motion.curves import HeadSway

    sway = HeadSway.seeded(T_REST, (0.1, 0.06, 0.04), (3, 5, 2), (1.4, 0.5), 0)
    smooth = curve_of(sway, 1.0)
    for t_s in (0.0, 0.123, 1.0):
        np.testing.assert_allclose(smooth.T_world_body(t_s), sway.T_world_body(t_s), atol=1e-8)
