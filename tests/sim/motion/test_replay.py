"""Replay: laws of the smoothing, placing and refusing."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.replay import Replay, hand_eye, smoothed
from places import SHARED
from refusals import refused

RATE_HZ = 120.0


def trajectory(positions_m, rotvecs=None, rate_hz=RATE_HZ, t_us=None):
    n = len(positions_m)
    t_us = np.rint(np.arange(n) / rate_hz * 1e6) if t_us is None else t_us
    rotvecs = np.zeros((n, 3)) if rotvecs is None else rotvecs
    quats = Rotation.from_rotvec(rotvecs).as_quat()
    return Trajectory(np.asarray(t_us, np.int64) + 5_000_000, np.asarray(positions_m, float), quats)


def sine(frequency_hz, amplitude, seconds=8.0):
    t_s = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    values = np.zeros((len(t_s), 3))
    values[:, 1] = amplitude * np.sin(2 * np.pi * frequency_hz * t_s)
    return values


def middle_rms(motion, channel):
    t_s = np.arange(2, 6, 1e-3)
    poses = motion.poses(t_s)
    angles = Rotation.from_matrix(poses[:, :3, :3]).as_rotvec()
    return float(
        np.sqrt(np.mean({"position": poses[:, 1, 3], "rotation": angles[:, 1]}[channel] ** 2))
    )


def gain(frequency_hz, rate_hz, cutoff_hz):
    """Amplitude gain of `smoothed` at (N,) frequencies, away from the ends."""
    ratio = np.sin(np.pi * frequency_hz / rate_hz) / np.sin(np.pi * cutoff_hz / rate_hz)
    return 1 / (1 + (np.sqrt(2) - 1) * ratio**6)


@pytest.mark.parametrize("channel", ["position", "rotation"])
@pytest.mark.parametrize("cutoff_hz", [5.0, 12.0])
def test_gain_is_minus_3_db_at_the_cutoff_passes_below_and_stops_above(channel, cutoff_hz):
    amplitude = 0.05
    for frequency_hz, low, high in (
        (0.3 * cutoff_hz, 0.998, 1.001), (cutoff_hz, 0.70, 0.714), (3 * cutoff_hz, 0.0, 0.008)
    ):  # fmt: skip
        values = sine(frequency_hz, amplitude)
        recorded = trajectory(values) if channel == "position" else trajectory(0 * values, values)
        replay = Replay(position_hz=cutoff_hz, rotation_hz=cutoff_hz, max_rate_rad_s=50)
        measured = middle_rms(replay.motion(recorded), channel) / (amplitude / np.sqrt(2))
        assert low <= measured <= high
        expected = gain(np.array([frequency_hz]), RATE_HZ, cutoff_hz)[0]
        assert measured == pytest.approx(expected, abs=2e-3)


def test_position_and_rotation_have_cutoffs_of_their_own():
    recorded = trajectory(sine(6, 0.05), sine(6, 0.05))
    motion = Replay(position_hz=3, rotation_hz=20).motion(recorded)
    assert middle_rms(motion, "position") < 0.05 * 0.05
    assert middle_rms(motion, "rotation") == pytest.approx(0.05 / np.sqrt(2), rel=5e-3)


def test_noise_gain_is_the_filters_own():
    """White noise keeps the mean of gain^2 of its variance: about 2 * cutoff / rate."""
    noise = np.random.default_rng(1).standard_normal((20_000, 3))
    cutoff_hz = 10.0
    measured = smoothed(noise, RATE_HZ, cutoff_hz).var() / noise.var()
    frequency = np.linspace(0, RATE_HZ / 2, 4001)
    expected = np.mean(gain(frequency, RATE_HZ, cutoff_hz) ** 2)
    assert measured == pytest.approx(expected, rel=0.05)
    assert expected == pytest.approx(2 * cutoff_hz / RATE_HZ, rel=0.1)


def test_a_parabola_and_a_steady_turn_pass_unchanged():
    t_s = np.arange(600) / RATE_HZ
    positions = np.column_stack([0.3 * t_s, 0.1 * t_s**2, 1 - 0.2 * t_s])
    turns = np.outer(t_s, [0.4, -0.9, 0.3])
    motion = Replay().motion(trajectory(positions, turns))
    poses = motion.poses(t_s)
    np.testing.assert_allclose(poses[:, :3, 3], positions, atol=2e-6)
    expected = Rotation.from_rotvec(turns)
    wrong = (Rotation.from_matrix(poses[:, :3, :3]) * expected.inv()).magnitude()
    assert wrong[60:-60].max() < 1e-6


def test_smoothing_does_not_depend_on_the_frames():
    rng = np.random.default_rng(0)
    turns = np.cumsum(0.01 * rng.standard_normal((400, 3)), axis=0)
    recorded = trajectory(np.cumsum(0.002 * rng.standard_normal((400, 3)), axis=0), turns)
    T_scene_world = look_at((1, 2, 3), (4, -1, 2))
    plain = Replay().motion(recorded)
    moved = Replay(T_scene_world=T_scene_world).motion(recorded)
    for t_s in (0.0, 0.7, 1.9, 3.3):
        np.testing.assert_allclose(
            moved.T_world_body(t_s), T_scene_world @ plain.T_world_body(t_s), atol=1e-9
        )


def test_scale_start_and_duration():
    recorded = trajectory(sine(0.5, 0.3), sine(0.4, 0.5))
    plain = Replay().motion(recorded)
    part = Replay(scale=2.5, start_s=1.5, duration_s=2.0).motion(recorded)
    assert part.duration_s == pytest.approx(2.0)
    for t_s in (0.0, 0.333, 2.0):
        expected = plain.T_world_body(1.5 + t_s)
        expected[:3, 3] *= 2.5
        np.testing.assert_allclose(part.T_world_body(t_s), expected, atol=1e-6)
    refused("spans 0 to", part.T_world_body, 2.01)


def test_hand_eye_turns_marker_poses_into_camera_poses():
    T_imu_marker, T_imu_cam = look_at((0, 0.1, 0), (1, 1, 1)), look_at((0.05, 0, 0), (1, 0, 0.2))
    T_marker_cam = hand_eye(T_imu_marker, T_imu_cam)
    np.testing.assert_allclose(T_imu_marker @ T_marker_cam, T_imu_cam, atol=1e-12)
    recorded = trajectory(sine(0.5, 0.3), sine(0.4, 0.5))
    plain = Replay().motion(recorded)
    camera = Replay(T_body_cam=T_marker_cam).motion(recorded)
    np.testing.assert_allclose(
        camera.T_world_body(2.2), plain.T_world_body(2.2) @ T_marker_cam, atol=1e-6
    )
    refused("T_imu_cam", hand_eye, T_imu_marker, np.zeros((4, 4)))


def test_uneven_times_are_brought_onto_a_grid():
    rng = np.random.default_rng(0)
    t_us = np.sort(np.rint((np.arange(900) + 0.3 * rng.uniform(-1, 1, 900)) / RATE_HZ * 1e6))
    t_s = (t_us - t_us[0]) * 1e-6
    positions = np.column_stack([np.sin(3 * t_s), np.cos(2 * t_s), 0 * t_s])
    motion = Replay().motion(trajectory(positions, t_us=t_us))
    np.testing.assert_allclose(motion.poses(t_s)[90:-90, :3, 3], positions[90:-90], atol=1e-4)


def test_a_real_head_replays_within_its_noise():

    from eventsweep.emvs.data.poses import read_poses

    path = SHARED / "data/tumvie/mocap-6dof.tum.txt"
    if not path.is_file():
        pytest.skip("needs ../shared/data, which is not part of the project")
    recorded = read_poses(path)
    motion = Replay().motion(recorded)
    t_s = (recorded.t_us - recorded.t_us[0]) * 1e-6
    error_m = np.linalg.norm(motion.poses(t_s)[:, :3, 3] - recorded.positions_m, axis=1)
    assert np.median(error_m) < 5e-4


@pytest.mark.parametrize(("change", "message"), [
    ("gap", r"a gap of 0\.5\d\d s 0\.825 s after its start, between poses 99 and 100"),
    ("jump", r"a jump at .* between poses 99 and 100"),
    ("turn", r"a turn at .* between poses 99 and 100"),
])  # fmt: skip
def test_gaps_and_jumps_are_refused_and_located(change, message):
    positions, turns = sine(0.5, 0.1), sine(0.5, 0.1)
    t_us = np.rint(np.arange(len(positions)) / RATE_HZ * 1e6)
    if change == "gap":
        t_us[100:] += 500_000
    elif change == "jump":
        positions[100:] += (0.5, 0, 0)
    else:
        turns[100:] += (1.0, 0, 0)
    refused(message, lambda: Replay().motion(trajectory(positions, turns, t_us=t_us)))


@pytest.mark.parametrize("settings", [
    {"position_hz": 60.0}, {"rotation_hz": 0.0}, {"rotation_hz": float("nan")},
    {"position_hz": 0.1}, {"scale": -1.0}, {"start_s": -1.0}, {"start_s": 99.0},
    {"duration_s": 9.0}, {"T_scene_world": 2 * np.eye(4)}, {"T_body_cam": np.zeros((4, 4))},
])  # fmt: skip
def test_bad_settings_are_refused(settings):
    refused("", lambda: Replay(**settings).motion(trajectory(sine(0.5, 0.1))))


def test_short_empty_and_nan_trajectories_are_refused():
    refused("5 poses", lambda: Replay().motion(trajectory(np.zeros((5, 3)))))
    refused("", trajectory, np.zeros((0, 3)))
    refused("not finite", trajectory, np.full((8, 3), np.nan))


def test_smoothed_poses_are_rigid():
    rng = np.random.default_rng(3)
    motion = Replay().motion(trajectory(sine(1, 0.1), sine(2, 0.8) + 0.01 * rng.standard_normal(3)))
    assert all(se3.is_rigid(motion.T_world_body(t), 1e-9) for t in np.linspace(0, 7, 50))
