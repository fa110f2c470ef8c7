"""IMU: laws of rest, rotation and integration; noise recovered from its own samples."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.tables import ImuSamples, read_imu, write_imu
from eventsweep.emvs.geometry import se3
from eventsweep.sim.config import ImuConfig
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import run, shake, walk
from eventsweep.sim.sensor.imu import GRAVITY_M_S2, imu_samples
from refusals import refused

NO_NOISE = {
    "gyro_noise": 0.0, "accel_noise": 0.0, "gyro_walk": 0.0, "accel_walk": 0.0,
    "gyro_bias": (0.0, 0.0, 0.0), "accel_bias": (0.0, 0.0, 0.0),
}  # fmt: skip
QUIET = ImuConfig(rate_hz=200, **NO_NOISE)
T_BODY_IMU = look_at((0.03, -0.05, 0.02), (0.3, 0.4, 0.1))


@dataclass(frozen=True)
class Turning:
    """A body that turns about a fixed axis through its origin."""

    T_world_start: np.ndarray
    omega_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def T_world_body(self, t_s):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(np.array(self.omega_rad_s) * t_s).as_matrix()
        return self.T_world_start @ turn


def integrated(samples: ImuSamples, T_start, velocity_m_s):
    """Plain strap-down integration: mean of neighbouring samples, pose after pose."""
    rotation = Rotation.from_matrix(T_start[:3, :3])
    position, velocity = T_start[:3, 3].copy(), np.array(velocity_m_s)
    poses = [T_start]
    for k in range(len(samples) - 1):
        dt = (samples.t_us[k + 1] - samples.t_us[k]) * 1e-6
        after = rotation * Rotation.from_rotvec(
            0.5 * (samples.gyro_rad_s[k] + samples.gyro_rad_s[k + 1]) * dt
        )
        force = 0.5 * (
            rotation.apply(samples.accel_m_s2[k]) + after.apply(samples.accel_m_s2[k + 1])
        )
        acceleration = force + GRAVITY_M_S2
        position = position + velocity * dt + 0.5 * acceleration * dt**2
        velocity, rotation = velocity + acceleration * dt, after
        poses.append(se3.from_rotation(rotation, position))
    return np.stack(poses)


def test_at_rest_it_measures_gravity_upwards_and_no_rotation():
    pose = look_at((1, 2, 3), (4, 3, 2))
    samples = imu_samples(Turning(pose), 0.5, QUIET, 0, T_BODY_IMU)
    up_imu = (pose @ T_BODY_IMU)[:3, :3].T @ (0, 0, 9.80665)
    np.testing.assert_allclose(samples.accel_m_s2, np.tile(up_imu, (len(samples), 1)), atol=1e-6)
    np.testing.assert_allclose(samples.gyro_rad_s, 0, atol=1e-6)


def test_a_pure_rotation_gives_its_rate_and_the_levers_centripetal_force():
    omega = np.array([0.4, -1.1, 0.7])
    level = look_at((0, 0, 0), (1, 0, 0))
    samples = imu_samples(
        Turning(level, tuple(omega)), 1.0, QUIET, 0, T_BODY_IMU, gravity_m_s2=(0, 0, 0)
    )
    R_imu_body, lever = T_BODY_IMU[:3, :3].T, T_BODY_IMU[:3, 3]
    np.testing.assert_allclose(samples.gyro_rad_s, np.tile(R_imu_body @ omega, (201, 1)), atol=1e-6)
    force = R_imu_body @ np.cross(omega, np.cross(omega, lever))
    np.testing.assert_allclose(samples.accel_m_s2, np.tile(force, (201, 1)), atol=1e-5)


@pytest.mark.parametrize("generator", [walk, run, shake])
def test_integrating_noise_free_samples_returns_the_trajectory(generator):
    """Trapezoids at 1 kHz: within 2 mm and 1 mrad after 3 s."""
    motion = generator(3, 4)
    samples = imu_samples(motion, 3, ImuConfig(rate_hz=1000, **NO_NOISE), 0, T_BODY_IMU)
    body = motion.kinematics([0.0])
    lever_velocity = np.cross(body.angular_velocity_rad_s[0], T_BODY_IMU[:3, 3])
    start = motion.T_world_body(0)
    velocity = body.velocity_m_s[0] + start[:3, :3] @ lever_velocity
    found = integrated(samples, start @ T_BODY_IMU, velocity)
    exact = motion.poses(samples.t_us * 1e-6) @ T_BODY_IMU
    assert np.linalg.norm(found[:, :3, 3] - exact[:, :3, 3], axis=1).max() < 2e-3
    turn = Rotation.from_matrix(np.swapaxes(found[:, :3, :3], 1, 2) @ exact[:, :3, :3])
    assert turn.magnitude().max() < 1e-3


def test_noise_density_is_recovered_by_allan_deviation():
    """White noise of density n has an Allan deviation of n / sqrt(tau)."""
    config = ImuConfig(rate_hz=200, gyro_walk=0, accel_walk=0)
    samples = imu_samples(Turning(np.eye(4)), 100, config, 3)
    for values, density in (
        (samples.gyro_rad_s, config.gyro_noise), (samples.accel_m_s2, config.accel_noise)
    ):  # fmt: skip
        for length in (1, 4):
            groups = values[: len(values) // length * length].reshape(-1, length, 3).mean(axis=1)
            allan = np.sqrt(0.5 * np.mean(np.diff(groups, axis=0) ** 2))
            assert allan * np.sqrt(length / 200) == pytest.approx(density, rel=0.05)


def test_bias_walks_with_its_density():
    config = ImuConfig(rate_hz=100, gyro_noise=0, accel_noise=0, gyro_walk=1e-3, accel_walk=1e-2,
                       gyro_bias=(0.01, 0, 0), accel_bias=(0, 0.2, 0))  # fmt: skip
    samples = imu_samples(Turning(np.eye(4)), 100, config, 0)
    np.testing.assert_allclose(samples.gyro_rad_s[0], (0.01, 0, 0), atol=1e-6)
    np.testing.assert_allclose(samples.accel_m_s2[0], (0, 0.2, 9.80665), atol=1e-6)
    steps = np.diff(samples.gyro_rad_s, axis=0)
    assert steps.std() == pytest.approx(1e-3 / np.sqrt(100), rel=0.05)


def test_noise_is_fixed_by_the_seed():
    motion = walk(1, 0)
    one, same, other = (imu_samples(motion, 1, ImuConfig(), seed) for seed in (1, 1, 2))
    assert np.array_equal(one.accel_m_s2, same.accel_m_s2)
    assert not np.array_equal(one.accel_m_s2, other.accel_m_s2)


def test_times_cover_the_motion_at_the_rate():
    samples = imu_samples(walk(0.507, 0), 0.507, ImuConfig(rate_hz=200), 0)
    assert samples.t_us[0] == 0
    assert samples.t_us[-1] == 505_000
    assert set(np.diff(samples.t_us)) == {5000}


def test_written_samples_read_back(tmp_path):
    samples = imu_samples(walk(0.2, 0), 0.2, ImuConfig(), 0, T_BODY_IMU)
    write_imu(tmp_path / "imu.csv", samples)
    back = read_imu(tmp_path / "imu.csv")
    np.testing.assert_allclose(back.T_body_imu, T_BODY_IMU, atol=1e-11)
    assert np.array_equal(back.t_us, samples.t_us)
    np.testing.assert_allclose(back.gyro_rad_s, samples.gyro_rad_s, rtol=1e-8)
    np.testing.assert_allclose(back.accel_m_s2, samples.accel_m_s2, rtol=1e-8)


def test_the_place_in_the_configuration_is_where_the_imu_sits():
    quat = tuple(Rotation.from_matrix(T_BODY_IMU[:3, :3]).as_quat().tolist())
    placed = ImuConfig(position_m=tuple(T_BODY_IMU[:3, 3].tolist()), quat_xyzw=quat)
    motion = walk(0.5, 0)
    one = imu_samples(motion, 0.5, placed.model_copy(update=NO_NOISE), 0)
    other = imu_samples(motion, 0.5, QUIET, 0, T_BODY_IMU)
    np.testing.assert_allclose(one.gyro_rad_s, other.gyro_rad_s, atol=1e-12)
    np.testing.assert_allclose(one.accel_m_s2, other.accel_m_s2, atol=1e-9)
    np.testing.assert_allclose(one.T_body_imu, T_BODY_IMU, atol=1e-12)


def test_bad_motions_are_refused():
    refused("rigid", imu_samples, walk(1, 0), 1, QUIET, 0, 2 * np.eye(4))
    refused("", imu_samples, walk(1, 0), 0, QUIET, 0)
    refused("0 Hz", imu_samples, walk(1, 0), 1, ImuConfig(rate_hz=0), 0)


HEAD = "# T_body_imu x_m y_m z_m qx qy qz qw: 0 0 0 0 0 0 1\n"


@pytest.mark.parametrize(("text", "words"), [
    (HEAD + "1,2,3\n", "seven"), (HEAD + "1,2,3,4,5,6,nan\n", "finite"),
    (HEAD + "1,2,3,4,5,6,7\n1,2,3,4,5,6,7\n", "increase"),
    (HEAD + "1,2,3,4,5,6,x\n", "cannot be read"), ("1,2,3,4,5,6,7\n", "first line"),
    (HEAD.replace("1\n", "2\n") + "1,2,3,4,5,6,7\n", "unit quaternion"),
    (HEAD.replace(" 1\n", "\n") + "1,2,3,4,5,6,7\n", "seven numbers"), ("", "first line"),
    ("\xb5", "cannot be read"), (None, "cannot be read"),
])  # fmt: skip
def test_files_that_hold_no_samples_are_refused(tmp_path, text, words):
    path = tmp_path / "imu.csv"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    refused(words, read_imu, path)
