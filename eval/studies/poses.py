"""Poses with noise, drift, a lower rate or a late clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from emvs.geometry import se3
from emvs.geometry.trajectory import Trajectory
from eval.studies.perturbation import Perturbation


def perturbed_trajectory(poses: Trajectory, amount: Perturbation, seed: int) -> Trajectory:
    """The poses with their errors.

    White noise and random walks act in the body's frame. Odometry drifts as it goes: the length of
    its steps is off by a share that wanders with a correlation time of a second, and its heading
    turns steadily about the world's z axis. The first pose is right, as an odometry's start is.
    """
    rng = np.random.default_rng([seed, 0x905E])
    thin = _at_rate(poses, amount.pose_rate_hz)
    T_world_body = thin.at(thin.t_us)
    dt_s = np.diff(thin.t_us, prepend=thin.t_us[0])[:, None] / 1e6
    # Drawn whatever the amounts: growing one of them must not shake the others anew.
    white, walk, wander = rng.normal(size=(3, len(thin), 6))
    drifted = _drifted(T_world_body, dt_s, wander[:, :1], amount)
    steps = np.sqrt(dt_s) * walk
    spread = np.array([[amount.pose_white_mm, amount.pose_white_deg]]).repeat(3, 1)
    slope = np.array([[amount.pose_walk_mm, amount.pose_walk_deg]]).repeat(3, 1)
    noise = spread * white + slope * np.cumsum(steps, axis=0)
    error = se3.from_rotation(Rotation.from_rotvec(noise[:, 3:], degrees=True), noise[:, :3] / 1e3)
    delay_us = round(1e3 * amount.pose_delay_ms)
    return Trajectory.from_matrices(thin.t_us + delay_us, drifted @ error)


def _at_rate(poses: Trajectory, rate_hz: float) -> Trajectory:
    """Some of the poses: the first in every period, and the last, so that the span stays."""
    if rate_hz == 0:
        return poses
    period = np.floor((poses.t_us - poses.t_us[0]) * (rate_hz / 1e6) + 1e-9)
    kept = np.flatnonzero(np.diff(period, prepend=-1) > 0)
    kept = np.union1d(kept, [len(poses) - 1])
    return Trajectory(poses.t_us[kept], poses.positions_m[kept], poses.quats_xyzw[kept])


def _drifted(
    T_world_body: NDArray[np.float64],
    dt_s: NDArray[np.float64],
    wander: NDArray[np.float64],
    amount: Perturbation,
) -> NDArray[np.float64]:
    share = amount.drift_percent / 100 * _correlated(dt_s[:, 0], wander[:, 0])
    yaw_deg = amount.drift_yaw_deg_s * np.cumsum(dt_s[:, 0])
    turn = Rotation.from_euler("z", yaw_deg[:, None], degrees=True)
    steps_m = np.diff(T_world_body[:, :3, 3], axis=0, prepend=T_world_body[:1, :3, 3])
    positions_m = T_world_body[0, :3, 3] + np.cumsum(
        turn.apply(steps_m * (1 + share[:, None])), axis=0
    )
    rotation = turn * Rotation.from_matrix(T_world_body[:, :3, :3])
    return se3.from_rotation(rotation, positions_m)


def _correlated(dt_s: NDArray[np.float64], white: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit-variance noise that forgets within a second (Ornstein-Uhlenbeck)."""
    keep = np.exp(-dt_s)
    value, values = 0.0, np.empty(len(white))
    for k in range(len(white)):
        value = white[k] if k == 0 else keep[k] * value + np.sqrt(1 - keep[k] ** 2) * white[k]
        values[k] = value
    return values
