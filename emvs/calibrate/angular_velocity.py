"""Pose clock and hand-eye rotation from angular velocities, those of the events and the poses'.

Jointly on sharpness a clock and a hand-eye trade off: over a short window both only change how the
camera turns. So each window is first asked by itself how fast it turned: the rotation, beside what
the poses say, that makes its DSI sharpest (contrast maximisation, Gallego and Scaramuzza, RA-L
2017, here with depth and all cameras instead of a homography). Then these angular velocities are
matched with those of the poses over all windows: the lag by correlation, the rotation by the
alignment of two sets of vectors (Kabsch 1976), both by least squares, as in hand-eye calibration
from gyroscopes. What remains between windows is the noise, and says how sure the result is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from emvs.calibrate.objective import Objective
from emvs.calibrate.parameters import Correction
from emvs.calibrate.quadratic import Paraboloid, fit
from emvs.geometry import se3
from emvs.geometry.trajectory import Trajectory
from emvs.sharpness import Told, WindowEvents

Floats = NDArray[np.float64]
_LAG_STEP_MS = 1.0
_SPREAD_STEPS = 4  # how far a window may turn otherwise than its poses say, 1 sigma


@dataclass(frozen=True, eq=False)
class TurnRates:
    """How fast the first camera turned in each window, in its own frame.

    Attributes:
        events: (W, 3) rad/s, as the events say.
        poses: (W, 3) rad/s, as the poses say, under the correction at hand.
        weight: (W, 3, 3) how sure the events are: minus the curvature of sharpness.
    """

    events: Floats
    poses: Floats
    weight: Floats


def turn_rates(
    objective: Objective, correction: Correction, step_rad_s: float, rounds: int = 2
) -> TurnRates:
    """Asks every window how fast it turned.

    Args:
        objective: sharpness of the windows.
        correction: the calibration so far.
        step_rad_s: by how much angular velocities are varied to see the sharpness fall.
        rounds: of fitting a paraboloid per window.
    """
    told = objective.told(correction)
    extra = np.zeros((len(objective.windows), 3))
    for _ in range(rounds):
        models = _each_window(objective, told, extra, step_rad_s)
        spread = np.full(3, _SPREAD_STEPS * step_rad_s)
        found = [one.estimate(spread, 1).point for one in models]
        extra = np.clip(found, extra - 2 * step_rad_s, extra + 2 * step_rad_s)
    poses = camera_turn_rates(objective.windows, told)
    weight = np.array([-one.curvature for one in models])
    return TurnRates(poses + extra, poses, weight)


def camera_turn_rates(windows: Sequence[WindowEvents], told: Told) -> Floats:
    """(W, 3) mean angular velocity of the first camera in each window, rad/s, in its own frame."""
    times_us = np.array([[one.t0_us, one.t1_us] for one in windows])
    R_world_cam = (told.trajectory.at(times_us) @ told.rig.T_body_cam[0])[..., :3, :3]
    R_begin_end = np.swapaxes(R_world_cam[:, 0], -1, -2) @ R_world_cam[:, 1]
    seconds = (times_us[:, 1] - times_us[:, 0]) / 1e6
    # The axis of a turn is the same in both frames; in the middle's frame it is so nearly
    half = Rotation.from_matrix(R_begin_end).as_rotvec()
    return np.asarray(half / seconds[:, None])


def _each_window(
    objective: Objective, told: Told, extra: Floats, step_rad_s: float
) -> list[Paraboloid]:
    """A paraboloid of each window's sharpness over its own additional turn."""

    def of_all(same: Floats) -> Floats:
        turned = [
            replace(told, trajectory=_turning(told, window, rate + same))
            for window, rate in zip(objective.windows, extra, strict=True)
        ]
        return np.log(objective.sharpness(turned))

    cache: dict[bytes, Floats] = {}

    def one(window: int, same: Floats) -> Floats:
        key = same.tobytes()
        if key not in cache:
            cache[key] = of_all(same)
        return cache[key][window : window + 1]

    steps = np.full(3, step_rad_s)
    models = [fit(partial(one, k), np.zeros(3), steps) for k in range(len(extra))]
    return [replace(model, point=rate) for model, rate in zip(models, extra, strict=True)]


def _turning(told: Told, window: WindowEvents, rate_rad_s: Floats) -> Trajectory:
    """The poses around a window with an additional turn of the first camera about its centre."""
    poses = told.trajectory
    length_us = window.t1_us - window.t0_us
    first, last = np.searchsorted(poses.t_us, [window.t0_us - length_us, window.t1_us + length_us])
    part = slice(max(0, int(first) - 1), int(last) + 1)
    t_us = poses.t_us[part]
    T_world_body = se3.from_quat_xyzw(poses.positions_m[part], poses.quats_xyzw[part])
    seconds = (t_us - window.t_ref_us) / 1e6
    turn = se3.from_rotation(
        Rotation.from_rotvec(seconds[:, None] * rate_rad_s), np.zeros((len(t_us), 3))
    )
    T_body_cam = told.rig.T_body_cam[0]
    turned = T_world_body @ T_body_cam @ turn @ se3.inverse(T_body_cam)
    return Trajectory.from_matrices(t_us, turned)


@dataclass(frozen=True, eq=False)
class Alignment:
    """The lag and the rotation that bring the poses' turn rates onto the events'.

    Attributes:
        lag_s: added to the poses' times.
        rotvec: (3,) rad, the first camera's rotation in what was taken for its frame.
        covariance: (4, 4) of lag and rotation vector, s and rad; infinite where undetermined.
        residual: (W, 3) rad/s, what remains.
    """

    lag_s: float
    rotvec: Floats
    covariance: Floats
    residual: Floats


class PoseTurns:
    """How fast the first camera turned in windows, as its poses say after a lag and a rotation.

    Args:
        windows: their times.
        told: what is said about the events.

    Attributes:
        lowest_s, highest_s: lags with which poses still cover all windows.
    """

    def __init__(self, windows: Sequence[WindowEvents], told: Told) -> None:
        self._windows, self._told = windows, told
        first_us, last_us = told.trajectory.span_us
        self.lowest_s = 1e-6 * (max(one.t1_us for one in windows) - last_us + 1)
        self.highest_s = 1e-6 * (min(one.t0_us for one in windows) - first_us - 1)

    def at(self, lag_s: float, rotvec: Floats) -> Floats:
        """(W, 3) mean angular velocities in the turned camera's frame, rad/s.

        Between whole µs of lag the rates are interpolated, so that they have a slope.
        """
        low_us = np.floor(1e6 * lag_s)
        share = 1e6 * lag_s - low_us
        rates = (1 - share) * self._lagging(int(low_us)) + share * self._lagging(int(low_us) + 1)
        return np.asarray(rates @ Rotation.from_rotvec(rotvec).as_matrix())

    def _lagging(self, lag_us: int) -> Floats:
        poses = self._told.trajectory
        later = replace(self._told, trajectory=replace(poses, t_us=poses.t_us + lag_us))
        return camera_turn_rates(self._windows, later)


def align(
    rates: TurnRates, turns: PoseTurns, most_lag_s: float, *, lag: bool, turn: bool
) -> Alignment:
    """Matches turn rates: lag by correlation, rotation by Kabsch, then both by least squares.

    Args:
        rates: of events and poses, per window.
        turns: the poses' after any lag and rotation.
        most_lag_s: how far the clock is searched.
        lag: whether the clock is free.
        turn: whether the rotation is free.
    """
    free = np.array([lag, turn, turn, turn])
    start = _correlated(rates, turns, most_lag_s if lag else 0.0, turn=turn)
    whiten = np.array([_root(one) for one in rates.weight])

    def residual(x: Floats) -> Floats:
        whole = start.copy()
        whole[free] = x
        left = rates.events - turns.at(1e-3 * whole[0], whole[1:])
        return np.asarray(np.einsum("wij,wj->wi", whiten, left).ravel())

    far = np.r_[1e3 * most_lag_s, np.full(3, np.pi)]
    low, high = (
        np.maximum(-far, [1e3 * turns.lowest_s, *-far[1:]]),
        np.minimum(far, [1e3 * turns.highest_s, *far[1:]]),
    )
    found = least_squares(
        residual, start[free], bounds=(low[free], high[free]), loss="soft_l1", diff_step=1e-4,
        x_scale=_SCALE[free],
    )  # fmt: skip
    start[free] = found.x
    left = rates.events - turns.at(1e-3 * start[0], start[1:])
    covariance = np.zeros((4, 4))
    covariance[np.ix_(free, free)] = _covariance(found.jac, found.fun)
    units = np.array([1e-3, 1, 1, 1])
    return Alignment(1e-3 * start[0], start[1:], covariance * units[:, None] * units, left)


_SCALE = np.array([1.0, 0.01, 0.01, 0.01])  # ms, rad


def _correlated(rates: TurnRates, turns: PoseTurns, most_lag_s: float, *, turn: bool) -> Floats:
    """(4,) the best lag of a grid, ms, and its rotation: the largest correlation of the rates."""
    low_ms = np.ceil(1e3 * max(-most_lag_s, turns.lowest_s)) if most_lag_s else 0
    high_ms = np.floor(1e3 * min(most_lag_s, turns.highest_s)) if most_lag_s else 0
    lags_ms = np.arange(low_ms, high_ms + 1, _LAG_STEP_MS)
    tried = []
    for lag_ms in lags_ms:
        poses = turns.at(1e-3 * lag_ms, np.zeros(3))
        rotvec = _kabsch(poses, rates.events) if turn else np.zeros(3)
        moved = poses @ Rotation.from_rotvec(rotvec).as_matrix()
        tried.append((float(((rates.events - moved) ** 2).sum()), lag_ms, rotvec))
    _, lag_ms, rotvec = min(tried, key=lambda one: one[0])
    return np.array([lag_ms, *rotvec])


def _kabsch(poses: Floats, events: Floats) -> Floats:
    """The rotation vector r of the camera with `events = poses @ R(r)`, least squares."""
    rotation, _ = Rotation.align_vectors(poses, events)
    return np.asarray(rotation.as_rotvec())


def _root(weight: Floats) -> Floats:
    """(3, 3) the root of a weight; directions in which nothing is known weigh nothing."""
    values, vectors = np.linalg.eigh(weight)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0)) @ vectors.T)


def _covariance(jacobian: Floats, residual: Floats) -> Floats:
    """Of a least-squares solution whose noise is as large as what remains."""
    count = jacobian.shape[1]
    normal = jacobian.T @ jacobian
    if len(residual) <= count or np.linalg.cond(normal) > 1e12:
        return np.full((count, count), np.inf)
    noise = float(residual @ residual) / (len(residual) - count)
    return np.asarray(noise * np.linalg.inv(normal))
