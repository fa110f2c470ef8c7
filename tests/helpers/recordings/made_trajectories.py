"""Trajectories that are made up: a way through a room, drift, another world, another clock."""

import numpy as np
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory


def room(seconds=10.0, rate_hz=100.0, seed=0):
    """A smooth way of about 1 m/s through three dimensions, looking about."""
    t = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 6)
    position_m = np.stack(
        [1.1 * np.sin(0.7 * t + phase[0]), 0.9 * np.cos(0.9 * t + phase[1]),
         0.3 * np.sin(1.3 * t + phase[2])], axis=1,
    )  # fmt: skip
    turn = np.stack([0.4 * np.sin((0.5 + 0.2 * k) * t + phase[3 + k]) for k in range(3)], axis=1)
    return made(t, position_m, Rotation.from_rotvec(turn))


def made(t_s, position_m, rotation):
    """A trajectory of columns."""
    t_us = np.round(1e6 * np.asarray(t_s)).astype(np.int64)
    return Trajectory(t_us, np.asarray(position_m, np.float64), rotation.as_quat())


def moved(trajectory, seed=1, scale=1.0):
    """The same seen from another world, perhaps of another size: `T_odom_body`."""
    rng = np.random.default_rng(seed)
    T_odom_world = se3.from_rotation(Rotation.random(rng=rng), rng.uniform(-5, 5, 3))
    T = T_odom_world @ trajectory.at(trajectory.t_us)
    T[:, :3, 3] *= scale
    return Trajectory.from_matrices(trajectory.t_us, T)


def noisy(trajectory, seed=2, sigma_m=0.01, sigma_deg=0.5):
    """With independent errors of every pose."""
    rng, count = np.random.default_rng(seed), len(trajectory)
    error = se3.from_rotation(
        Rotation.from_rotvec(np.radians(sigma_deg) * rng.normal(size=(count, 3))),
        sigma_m * rng.normal(size=(count, 3)),
    )
    return Trajectory.from_matrices(trajectory.t_us, trajectory.at(trajectory.t_us) @ error)


def part(trajectory, chosen):
    """Some of the poses."""
    columns = trajectory.t_us, trajectory.positions_m, trajectory.quats_xyzw
    return Trajectory(*(column[chosen] for column in columns))


def on_clock(trajectory, factor=1.0, shift_us=0):
    """With other times."""
    t_us = np.round(factor * trajectory.t_us).astype(np.int64) + shift_us
    return Trajectory(t_us, trajectory.positions_m, trajectory.quats_xyzw)
