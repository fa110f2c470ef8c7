"""Inertial samples from the same curve as the pictures: gyroscope and accelerometer, with noise.

The noise model is the one of Kalibr and Basalt: white noise of a density per root hertz, sampled
at the IMU's rate, plus a bias that walks at random.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.tables import ImuSamples
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.sim.config import ImuConfig
from eventsweep.sim.motion import Motion
from eventsweep.sim.motion.curves import curve_of

Array = NDArray[np.float64]
GRAVITY_M_S2 = (0.0, 0.0, -9.80665)
"""Standard gravity in a world whose z is up."""
# Sets the noise apart from what else is drawn from a sequence's seed.
_STREAM = 0x1A05


def imu_samples(
    motion: Motion,
    duration_s: float,
    config: ImuConfig,
    seed: int,
    T_body_imu: Array | None = None,
    gravity_m_s2: tuple[float, float, float] = GRAVITY_M_S2,
) -> ImuSamples:
    """Samples an IMU that rides on a body's motion over [0, `duration_s`].

    Args:
        motion: of the body.
        duration_s: length, s.
        config: rate, noise and bias, and where the IMU sits.
        seed: of the noise, not negative.
        T_body_imu: (4, 4) where the IMU sits, instead of where `config` says.
        gravity_m_s2: (3,) in the world.

    Raises:
        InputError: no positive duration or rate, or `T_body_imu` is not rigid.
    """
    if not config.rate_hz:
        raise InputError("an IMU at 0 Hz takes no samples: give a rate_hz")
    if T_body_imu is None:
        T_body_imu = se3.from_quat_xyzw(config.position_m, config.quat_xyzw)
    if fault := se3.fault(T_body_imu):
        raise InputError(
            f"T_body_imu is not a rigid (4, 4) transform ({fault}): give a rotation and a "
            "translation"
        )
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
    gyro_rng, accel_rng = np.random.default_rng([_STREAM, seed]).spawn(2)
    gyro = omega @ T_body_imu[:3, :3]
    accel = force @ T_body_imu[:3, :3]
    rate = config.rate_hz
    gyro += _noise(gyro_rng, count, rate, config.gyro_noise, config.gyro_walk, config.gyro_bias)
    accel += _noise(
        accel_rng, count, rate, config.accel_noise, config.accel_walk, config.accel_bias
    )
    return ImuSamples(t_us, gyro, accel, T_body_imu)


def _noise(
    rng: np.random.Generator, count: int, rate_hz: float, density: float, walk: float,
    bias: tuple[float, float, float],
) -> Array:  # fmt: skip
    """White noise (N, 3) of std density sqrt(rate), on a bias of steps walk / sqrt(rate)."""
    white = rng.standard_normal((count, 3)) * density * np.sqrt(rate_hz)
    steps = rng.standard_normal((count, 3)) * walk / np.sqrt(rate_hz)
    steps[0] = 0
    noise: Array = white + np.cumsum(steps, axis=0) + np.asarray(bias)
    return noise
