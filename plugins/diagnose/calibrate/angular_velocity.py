"""Pose clock and hand-eye rotation from angular velocities, those of the events and the poses'.

Sharpness alone hardly separates a clock from a hand-eye: over a short window both only change how
the camera turns. So the turn rate of each window is estimated first: the rotation, in addition to
that of the poses, that makes its DSI sharpest (contrast maximisation, Gallego and Scaramuzza, RA-L
2017, here with depth and all cameras instead of a homography). Then these angular velocities are
matched with those of the poses over all windows by least squares, the lag over a grid first, as in
hand-eye calibration from gyroscopes. The residuals between windows are the noise, against which the
prior, the calibration as given, is weighted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose.calibrate.objective import Objective
from eventsweep.plugins.diagnose.calibrate.quadratic import Paraboloid, fit
from eventsweep.plugins.diagnose.parameters import Correction
from eventsweep.plugins.diagnose.sharpness import Hypothesis, WindowEvents, around

Floats = NDArray[np.float64]
_LAG_STEP_MS = 1.0
_SPREAD_STEPS = 4  # prior on how far a window's turn differs from its poses', 1 sigma


@dataclass(frozen=True, eq=False)
class TurnRates:
    """How fast the first camera turned in each window, (W, 3) rad/s in its own frame.

    `events` is estimated from the events, `poses` is that of the poses under the correction at
    hand; the (W, 3, 3) weight of the events' estimates is minus the curvature of sharpness.
    """

    events: Floats
    poses: Floats
    weight: Floats


def turn_rates(
    objective: Objective, correction: Correction, step_rad_s: float, rounds: int = 2
) -> TurnRates:
    """Estimates how fast the camera turned in every window, by differences of `step_rad_s`."""
    hypothesis = objective.hypothesis(correction)
    extra = np.zeros((len(objective.windows), 3))
    for _ in range(rounds):
        models = _each_window(objective, hypothesis, extra, step_rad_s)
        spread = np.full(3, _SPREAD_STEPS * step_rad_s)
        tops = [model.estimate(spread, 1).point for model in models]
        extra = np.clip(tops, extra - 2 * step_rad_s, extra + 2 * step_rad_s)
    poses = camera_turn_rates(objective.windows, hypothesis)
    weight = np.array([-model.curvature for model in models])
    return TurnRates(poses + extra, poses, weight)


def camera_turn_rates(windows: Sequence[WindowEvents], hypothesis: Hypothesis) -> Floats:
    """(W, 3) mean angular velocity of the first camera in each window, rad/s, in its own frame."""
    times_us = np.array([[window.t0_us, window.t1_us] for window in windows])
    T_world_cam = hypothesis.trajectory.at(times_us) @ hypothesis.rig.T_body_cam[0]
    R_world_cam = T_world_cam[..., :3, :3]
    R_begin_end = np.swapaxes(R_world_cam[:, 0], -1, -2) @ R_world_cam[:, 1]
    seconds = (times_us[:, 1] - times_us[:, 0]) / 1e6
    # The axis of a turn is the same in both frames; in the middle's frame it is so nearly
    half = Rotation.from_matrix(R_begin_end).as_rotvec()
    return np.asarray(half / seconds[:, None])


def _each_window(
    objective: Objective, hypothesis: Hypothesis, extra: Floats, step_rad_s: float
) -> list[Paraboloid]:
    """A paraboloid of each window's sharpness over its own additional turn."""

    def of_all(same: Floats) -> Floats:
        turned = [
            replace(hypothesis, trajectory=_turning(hypothesis, window, rate + same))
            for window, rate in zip(objective.windows, extra, strict=True)
        ]
        return np.log(objective.sharpness(turned))

    cache: dict[bytes, Floats] = {}

    def of_window(window: int, same: Floats) -> Floats:
        key = same.tobytes()
        if key not in cache:
            cache[key] = of_all(same)
        return cache[key][window : window + 1]

    steps = np.full(3, step_rad_s)
    models = [fit(partial(of_window, k), np.zeros(3), steps) for k in range(len(extra))]
    return [replace(model, point=rate) for model, rate in zip(models, extra, strict=True)]


def _turning(hypothesis: Hypothesis, window: WindowEvents, rate_rad_s: Floats) -> Trajectory:
    """The poses around a window with an additional turn of the first camera about its centre."""
    poses = hypothesis.trajectory
    length_us = window.t1_us - window.t0_us
    part = around(poses, window.t0_us - length_us, window.t1_us + length_us)
    t_us = poses.t_us[part]
    T_world_body = se3.from_quat_xyzw(poses.positions_m[part], poses.quats_xyzw[part])
    seconds = (t_us - window.t_ref_us) / 1e6
    turn = se3.from_rotation(
        Rotation.from_rotvec(seconds[:, None] * rate_rad_s), np.zeros((len(t_us), 3))
    )
    T_body_cam = hypothesis.rig.T_body_cam[0]
    turned = T_world_body @ T_body_cam @ turn @ se3.inverse(T_body_cam)
    return Trajectory.from_matrices(t_us, turned)


class PoseTurns:
    """Turn rates of the first camera in windows, from its poses after a lag and a rotation.

    Poses cover all windows with lags from `lowest_s` to `highest_s`.
    """

    def __init__(self, windows: Sequence[WindowEvents], hypothesis: Hypothesis) -> None:
        self._windows, self._hypothesis = windows, hypothesis
        first_us, last_us = hypothesis.trajectory.span_us
        self.lowest_s = 1e-6 * (max(window.t1_us for window in windows) - last_us + 1)
        self.highest_s = 1e-6 * (min(window.t0_us for window in windows) - first_us - 1)

    def at(self, lag_s: float, rotvec: Floats) -> Floats:
        """(W, 3) mean angular velocities in the turned camera's frame, rad/s.

        Between whole µs of lag the rates are interpolated, so that they have a slope.
        """
        low_us = np.floor(1e6 * lag_s)
        share = 1e6 * lag_s - low_us
        rates = (1 - share) * self._lagging(int(low_us)) + share * self._lagging(int(low_us) + 1)
        return np.asarray(rates @ Rotation.from_rotvec(rotvec).as_matrix())

    def _lagging(self, lag_us: int) -> Floats:
        poses = self._hypothesis.trajectory
        later = replace(self._hypothesis, trajectory=replace(poses, t_us=poses.t_us + lag_us))
        return camera_turn_rates(self._windows, later)


def align(rates: TurnRates, turns: PoseTurns, so_far: Floats, spread: Floats) -> Floats:
    """Matches turn rates: lag and rotation over a grid of lags, then both by least squares.

    A camera that turns little leaves them open: then the prior, weighted against the noise of the
    rates, keeps them near the calibration as given.

    Args:
        rates: of events and poses, per window.
        turns: those of the poses after any lag and rotation.
        so_far: (4,) lag in ms and rotation vector in rad from earlier rounds.
        spread: (4,) prior of their sums, 1 sigma; 0 keeps a value fixed.

    Returns:
        (4,) what to add to `so_far`; the rotation is in the first camera's frame as given.
    """
    free = spread > 0
    # The roots of the weights; unknown directions weigh nothing.
    values, vectors = np.linalg.eigh(rates.weight)
    roots = vectors * np.sqrt(np.maximum(values, 0))[:, None]
    whiten = np.asarray(roots @ np.swapaxes(vectors, 1, 2))
    start, noise = _nearest(rates, turns, whiten, so_far, spread)

    def residual(x: Floats) -> Floats:
        whole = start.copy()
        whole[free] = x
        left = rates.events - turns.at(1e-3 * whole[0], whole[1:])
        prior = (so_far + whole)[free] / spread[free]
        return np.asarray(np.r_[np.einsum("wij,wj->wi", whiten, left).ravel() / noise, prior])

    low, high = np.full(4, -np.pi), np.full(4, np.pi)
    low[0], high[0] = _lag_limits_ms(turns, spread[0])
    solved = least_squares(
        residual, start[free], bounds=(low[free], high[free]), loss="soft_l1", diff_step=1e-4,
        x_scale=_SCALE[free],
    )  # fmt: skip
    start[free] = solved.x
    return start


_SCALE = np.array([1.0, 0.01, 0.01, 0.01])  # ms, rad


def _lag_limits_ms(turns: PoseTurns, spread_ms: float) -> tuple[float, float]:
    """Lags to search: to 2 sigma, and as far as poses cover all windows."""
    return max(-2 * spread_ms, 1e3 * turns.lowest_s), min(2 * spread_ms, 1e3 * turns.highest_s)


def _nearest(
    rates: TurnRates, turns: PoseTurns, whiten: Floats, so_far: Floats, spread: Floats
) -> tuple[Floats, float]:
    """(4,) the best lag of a grid with its small rotation, and the noise of whitened rates."""
    low_ms, high_ms = _lag_limits_ms(turns, spread[0])
    lags_ms = np.arange(np.ceil(low_ms), np.floor(high_ms) + 1, _LAG_STEP_MS)
    lines = [_linear(rates, turns.at(1e-3 * lag, np.zeros(3)), whiten) for lag in lags_ms]
    open_ = spread[1:] > 0
    lines = [(missing, slope * open_) for missing, slope in lines]
    noise = max(min(map(_unexplained, lines)), 1e-9)
    starts = [
        np.r_[lag, _small_turn(*line, noise, so_far[1:], spread[1:])]
        for lag, line in zip(lags_ms, lines, strict=True)
    ]
    free = spread > 0

    def score(lag: int) -> float:
        missing, slope = lines[lag]
        left = (missing - slope @ starts[lag][1:]) / noise
        prior = (so_far + starts[lag])[free] / spread[free]
        return float(left @ left + prior @ prior)

    return starts[min(range(len(starts)), key=score)], noise


def _linear(rates: TurnRates, poses: Floats, whiten: Floats) -> tuple[Floats, Floats]:
    """(3W,) whitened error of the poses' rates, and (3W, 3) its slope over a small rotation.

    A camera turned by r turns at `R(r)^T w`, nearly `w + w x r`.
    """
    missing = np.einsum("wij,wj->wi", whiten, rates.events - poses)
    across = np.cross(poses[:, None], np.eye(3))
    return missing.ravel(), np.einsum("wij,wkj->wik", whiten, across).reshape(-1, 3)


def _unexplained(line: tuple[Floats, Floats]) -> float:
    """Root mean square of what no rotation explains."""
    missing, slope = line
    left = missing - slope @ np.linalg.lstsq(slope, missing, rcond=None)[0]
    return float(np.sqrt((left**2).mean()))


def _small_turn(
    missing: Floats, slope: Floats, noise: float, so_far: Floats, spread: Floats
) -> Floats:
    """(3,) the rotation vector that fits best, weighted against the prior."""
    weight = noise**2 / np.where(spread > 0, spread, np.inf) ** 2
    normal = slope.T @ slope + np.diag(np.where(spread > 0, weight, 1.0))
    return np.asarray(np.linalg.solve(normal, slope.T @ missing - weight * so_far))
