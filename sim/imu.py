"""Inertial samples from the same curve as the pictures: gyroscope and accelerometer, with noise.

The noise model is the one of Kalibr and Basalt: white noise of a density per root hertz, sampled
at the IMU's rate, plus a bias that walks at random.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emvs.atomic import atomic_path
from emvs.data import se3
from emvs.errors import InputError
from sim.motion import Motion
from sim.motion_curve import curve_of

Array = NDArray[np.float64]
GRAVITY_M_S2 = (0.0, 0.0, -9.80665)


@dataclass(frozen=True, kw_only=True)
class ImuConfig:
    """An IMU. The defaults are a consumer MEMS device's, of the order of Bosch's BMI160.

    Attributes:
        rate_hz: samples per second.
        gyro_noise: density, rad/s/sqrt(Hz).
        accel_noise: density, m/s^2/sqrt(Hz).
        gyro_walk: of the bias, rad/s^2/sqrt(Hz).
        accel_walk: of the bias, m/s^3/sqrt(Hz).
        gyro_bias: (3,) at the start, rad/s.
        accel_bias: (3,) at the start, m/s^2.
    """

    rate_hz: float = 200.0
    gyro_noise: float = 1.2e-4
    accel_noise: float = 1.8e-3
    gyro_walk: float = 2e-6
    accel_walk: float = 3e-5
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate_hz) and 1 <= self.rate_hz <= 1e5):
            raise InputError(f"IMU at {self.rate_hz} Hz: rate_hz must lie from 1 to 100000")
        for name in ("gyro_noise", "accel_noise", "gyro_walk", "accel_walk"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"IMU with {name} = {value}: it must be finite, not negative")
        if not np.isfinite([*self.gyro_bias, *self.accel_bias]).all():
            raise InputError("IMU with a bias that is not finite: give three numbers each")

    def noiseless(self) -> ImuConfig:
        """The same IMU without noise and bias."""
        return ImuConfig(
            rate_hz=self.rate_hz, gyro_noise=0, accel_noise=0, gyro_walk=0, accel_walk=0
        )


@dataclass(frozen=True, eq=False)
class ImuSamples:
    """What an IMU reports, in its own axes.

    Attributes:
        t_us: (N,) int64, µs.
        gyro_rad_s: (N, 3) rotation rate.
        accel_m_s2: (N, 3) specific force: at rest it is 9.8 upwards.
    """

    t_us: NDArray[np.int64]
    gyro_rad_s: Array
    accel_m_s2: Array

    def __len__(self) -> int:
        return len(self.t_us)


def imu_samples(
    motion: Motion,
    duration_s: float,
    config: ImuConfig,
    seed: int,
    T_body_imu: Array | None = None,
    gravity_m_s2: tuple[float, float, float] = GRAVITY_M_S2,
) -> ImuSamples:
    """Samples an IMU that rides on `motion` over [0, `duration_s`].

    Args:
        motion: of the body.
        duration_s: length, s.
        config: rate, noise and bias.
        seed: of the noise.
        T_body_imu: (4, 4) where the IMU sits; None for the body's own frame.
        gravity_m_s2: (3,) in the world.

    Raises:
        InputError: no positive duration, or `T_body_imu` is not rigid.
    """
    T_body_imu = np.eye(4) if T_body_imu is None else np.asarray(T_body_imu, float)
    if not se3.is_rigid(T_body_imu):
        raise InputError("T_body_imu is no rigid (4, 4) motion: give a rotation and a shift")
    body = curve_of(motion, duration_s)
    count = int(np.floor(duration_s * config.rate_hz + 1e-9)) + 1
    t_us = np.rint(np.arange(count) / config.rate_hz * 1e6).astype(np.int64)
    times_s = np.minimum(t_us * 1e-6, duration_s)
    moving = body.kinematics(times_s)
    omega, alpha = moving.angular_velocity_rad_s, moving.angular_acceleration_rad_s2
    lever = T_body_imu[:3, 3]
    force_world = moving.acceleration_m_s2 - np.asarray(gravity_m_s2)
    R_world_body = body.poses(times_s)[:, :3, :3]
    force = np.einsum("nji,nj->ni", R_world_body, force_world)
    force += np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever))
    gyro_rng, accel_rng = np.random.default_rng(seed).spawn(2)
    gyro = omega @ T_body_imu[:3, :3]
    accel = force @ T_body_imu[:3, :3]
    rate = config.rate_hz
    gyro += _noise(gyro_rng, count, rate, config.gyro_noise, config.gyro_walk, config.gyro_bias)
    accel += _noise(
        accel_rng, count, rate, config.accel_noise, config.accel_walk, config.accel_bias
    )
    return ImuSamples(t_us, gyro, accel)


def write_imu(path: Path, samples: ImuSamples) -> None:
    """Writes `imu.csv`: time in µs, gyroscope in rad/s, accelerometer in m/s^2, one row each."""
    with atomic_path(Path(path)) as partial, partial.open("w", encoding="ascii") as file:
        file.write("#t_us,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n")
        rows = np.hstack([samples.gyro_rad_s, samples.accel_m_s2]).tolist()
        for t_us, row in zip(samples.t_us.tolist(), rows, strict=True):
            file.write(f"{t_us}," + ",".join(f"{value:.9g}" for value in row) + "\n")


def read_imu(path: Path) -> ImuSamples:
    """Reads what `write_imu` wrote.

    Raises:
        InputError: no such file, or not seven numbers in every row.
    """
    try:
        table = np.loadtxt(path, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: cannot be read as IMU samples ({reason})") from error
    if table.shape[1] != 7 or not np.isfinite(table).all():
        raise InputError(f"{path}: needs rows of seven finite numbers, t_us, gyro, accel")
    return ImuSamples(table[:, 0].astype(np.int64), table[:, 1:4], table[:, 4:])


def _noise(
    rng: np.random.Generator,
    count: int,
    rate_hz: float,
    density: float,
    walk: float,
    bias: tuple[float, float, float],
) -> Array:
    """White noise (N, 3) of std density sqrt(rate), on a bias of steps walk / sqrt(rate)."""
    white = rng.standard_normal((count, 3)) * density * np.sqrt(rate_hz)
    steps = rng.standard_normal((count, 3)) * walk / np.sqrt(rate_hz)
    steps[0] = 0
    noise: Array = white + np.cumsum(steps, axis=0) + np.asarray(bias)
    return noise
