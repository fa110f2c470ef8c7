"""Replay of recorded trajectories: low-passed, placed and scaled into a scene, as a smooth motion.

The recorded poses are brought onto an even grid and smoothed by the discrete smoothing spline of
order 3 (Whittaker 1923; Eilers, Anal. Chem. 2003): x minimises |x - y|^2 + lambda |D^3 x|^2. In
the middle of the recording it is a filter without phase, of gain 1 / (1 + lambda (2 sin(w/2))^6),
so lambda is chosen for a gain of exactly -3 dB at the cut-off. Rotations are smoothed as
quaternions in R^4 and normalised: the chordal mean on SO(3), which does not depend on the choice
of either frame and passes a steady rotation unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.sim.motion.curves import CurveMotion, curve

if TYPE_CHECKING:
    from eventsweep.emvs.geometry.trajectory import Trajectory

Array = NDArray[np.float64]
_ORDER = 3
# Beyond this ratio of pose rate to cut-off the system of equations is ill-conditioned.
_MAX_OVERSAMPLING = 250.0
# Periods of the cut-off after which the smoothing has forgotten a pose, see `Replay._near`.
_MEMORY_PERIODS = 10.0


@dataclass(frozen=True, kw_only=True)
class Replay:
    """How a recorded trajectory becomes a motion; call `motion` on one.

    Attributes:
        position_hz: -3 dB cut-off of the position, Hz.
        rotation_hz: -3 dB cut-off of the rotation, Hz.
        start_s: first time to replay, s after the trajectory's first pose.
        duration_s: how long; None for all that is left.
        T_scene_world: (4, 4) where the recording's world lies in the scene; None for the identity.
        scale: factor on the recorded positions, before they are placed.
        T_body_cam: (4, 4) camera in the recorded body, see `hand_eye`; None for the identity.
        max_gap_s: longest time without a pose.
        max_speed_m_s: fastest step between two poses, before scaling.
        max_rate_rad_s: fastest turn between two poses; heads reach 14 rad/s (Grossman 1988).
    """

    position_hz: float = 10.0
    rotation_hz: float = 10.0
    start_s: float = 0.0
    duration_s: float | None = None
    T_scene_world: Array | None = None
    scale: float = 1.0
    T_body_cam: Array | None = None
    max_gap_s: float = 0.05
    max_speed_m_s: float = 12.0
    max_rate_rad_s: float = 20.0

    def motion(self, recorded: Trajectory) -> CurveMotion:
        """Returns the replayed motion over [0, duration].

        Raises:
            InputError: too short, a gap, a jump, or a cut-off that the pose rate does not carry.
        """
        self._check_settings()
        all_s = (recorded.t_us - recorded.t_us[0]) * 1e-6
        near = self._near(all_s)
        self._check_steps(recorded, all_s, near)
        channels = np.hstack([recorded.positions_m, recorded.quats_xyzw])[near]
        grid_s, channels = _even(all_s[near] - all_s[near][0], channels)
        rate_hz = 1 / (grid_s[1] - grid_s[0])
        positions = smoothed(channels[:, :3], rate_hz, self.position_hz)
        quats = smoothed(channels[:, 3:], rate_hz, self.rotation_hz)
        placed = self._placed(positions, quats)
        start_s = self.start_s - float(all_s[near][0])
        return self._cut(curve(grid_s, *se3.to_quat_xyzw(placed)), start_s, rate_hz)

    def _near(self, t_s: Array) -> slice:
        """The poses that the replayed part depends on.

        The smoothing of order 3 forgets by exp(-pi f t): e^-31 within ten periods of the cut-off.
        """
        length_s = float(t_s[-1]) if self.duration_s is None else self.duration_s
        if not 0 < length_s <= t_s[-1] - self.start_s + 1e-9:
            wanted = "anything" if self.duration_s is None else f"{self.duration_s:g} s"
            raise InputError(
                f"{wanted} requested from {self.start_s:g} s on, but the trajectory lasts "
                f"{t_s[-1]:.3f} s: start earlier or replay less"
            )
        margin_s = _MEMORY_PERIODS / min(self.position_hz, self.rotation_hz)
        end_s = self.start_s + length_s
        first, last = np.searchsorted(t_s, [self.start_s - margin_s, end_s + margin_s])
        return slice(max(0, int(first) - 2 * _ORDER), int(last) + 2 * _ORDER)

    def _placed(self, positions: Array, quats: Array) -> Array:
        """Poses of the camera in the scene: the hand-eye first (never scaled), then the scale."""
        T_body_cam = np.eye(4) if self.T_body_cam is None else self.T_body_cam
        T_scene_world = np.eye(4) if self.T_scene_world is None else self.T_scene_world
        T_world_cam = se3.from_quat_xyzw(positions, quats) @ T_body_cam
        T_world_cam[:, :3, 3] *= self.scale
        placed: Array = T_scene_world @ T_world_cam
        return placed

    def _cut(self, whole: CurveMotion, start_s: float, rate_hz: float) -> CurveMotion:
        left_s = whole.duration_s - start_s
        duration_s = left_s if self.duration_s is None else self.duration_s
        count = max(6, int(np.ceil(duration_s * rate_hz)) + 1)
        times = np.linspace(0, min(duration_s, left_s), count)
        poses = whole.poses(start_s + times)
        return curve(times, *se3.to_quat_xyzw(poses))

    def _check_settings(self) -> None:
        for name in ("position_hz", "rotation_hz", "scale", "max_gap_s"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"replay with {name} = {value}: it must be positive")
        if not (np.isfinite(self.start_s) and self.start_s >= 0):
            raise InputError(f"replay from {self.start_s} s: start at 0 or later")
        for name in ("T_scene_world", "T_body_cam"):
            pose = getattr(self, name)
            if pose is not None and (fault := se3.fault(np.asarray(pose))):
                raise InputError(
                    f"{name} is not a rigid (4, 4) transform ({fault}): give a rotation and a "
                    "translation"
                )

    def _check_steps(self, recorded: Trajectory, t_s: Array, near: slice) -> None:
        if len(recorded) < 2 * _ORDER:
            raise InputError(f"trajectory of {len(recorded)} poses: replay needs {2 * _ORDER}")
        t_s, quats = t_s[near], recorded.quats_xyzw[near]
        step_s = np.diff(t_s)
        shift_m = np.linalg.norm(np.diff(recorded.positions_m[near], axis=0), axis=1)
        cosine = np.abs(np.sum(quats[1:] * quats[:-1], axis=1))
        turn_rad = 2 * np.arccos(np.minimum(cosine, 1))
        for value, name, what, cure in (
            (step_s, "max_gap_s", "a gap of {:.3f} s", "fill or cut it"),
            (shift_m / step_s, "max_speed_m_s", "a jump at {:.3g} m/s", "remove the jump"),
            (turn_rad / step_s, "max_rate_rad_s", "a turn at {:.3g} rad/s", "remove the jump"),
        ):
            _refuse(value, getattr(self, name), t_s, near.start, what, name, cure)


def smoothed(values: Array, rate_hz: float, cutoff_hz: float) -> Array:
    """Low-passes (N, C) even samples by the smoothing spline of order 3, -3 dB at `cutoff_hz`.

    N is 6 or more; beyond `rate_hz` / 250 the system is ill-conditioned.

    Raises:
        InputError: a cut-off below that, or not below `rate_hz` / 2.
    """
    from scipy.linalg import solveh_banded

    if not rate_hz / _MAX_OVERSAMPLING <= cutoff_hz < rate_hz / 2:
        raise InputError(
            f"cut-off of {cutoff_hz} Hz for {rate_hz:.4g} poses per second: it must lie from "
            f"{rate_hz / _MAX_OVERSAMPLING:.3g} to below {rate_hz / 2:.4g} Hz"
        )
    weight = (np.sqrt(2) - 1) / (2 * np.sin(np.pi * cutoff_hz / rate_hz)) ** (2 * _ORDER)
    band = weight * _penalty_band(len(values))
    band[-1] += 1
    # The straight line through the ends is passed unchanged anyway; without it, rounding is less.
    line = np.linspace(values[0], values[-1], len(values))
    smooth: Array = line + solveh_banded(band, values - line)
    return smooth


def hand_eye(T_imu_marker: Array, T_imu_cam: Array) -> Array:
    """Returns `T_marker_cam` (4, 4), which turns poses of a mocap marker into the camera's.

    TUM-VIE gives `T_imu_marker` in its mocap-imu calibration and `T_imu_cam` in the camera
    calibration, where the left event camera is entry 2.
    """
    for name, pose in (("T_imu_marker", T_imu_marker), ("T_imu_cam", T_imu_cam)):
        if fault := se3.fault(np.asarray(pose)):
            raise InputError(
                f"{name} is not a rigid (4, 4) transform ({fault}): check the calibration"
            )
    T_marker_cam: Array = se3.inverse(T_imu_marker) @ T_imu_cam
    return T_marker_cam


def _penalty_band(count: int) -> Array:
    """Upper band (4, N) of D^T D for third differences D, as `solveh_banded` wants it."""
    third = np.array([-1.0, 3.0, -3.0, 1.0])
    band = np.zeros((_ORDER + 1, count))
    for i in range(_ORDER + 1):
        for j in range(i, _ORDER + 1):
            band[_ORDER - (j - i), j : j + count - _ORDER] += third[i] * third[j]
    return band


def _even(t_s: Array, values: Array) -> tuple[Array, Array]:
    """Values on an even grid of the same span and mean rate, by cubic splines where needed."""
    from scipy.interpolate import CubicSpline

    grid_s = np.linspace(0, t_s[-1], len(t_s))
    if np.abs(grid_s - t_s).max() < 2e-6:
        return grid_s, values
    return grid_s, np.asarray(CubicSpline(t_s, values)(grid_s), np.float64)


def _refuse(
    value: Array, limit: float, t_s: Array, first: int, what: str, name: str, cure: str
) -> None:
    k = int(np.argmax(value))
    if value[k] > limit * (1 + 1e-9):
        raise InputError(
            f"the trajectory has {what.format(value[k])} {t_s[k]:.3f} s after its start, between "
            f"poses {first + k} and {first + k + 1} (limit {limit:g}): {cure}, or raise {name}"
        )
