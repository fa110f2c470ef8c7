"""Motions: the rig's pose as a smooth function of time.

Heads that sway (`HeadSway`), and quintic splines with exact derivatives (`CurveMotion`), which
generated and recorded motions are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.sim.motion import Motion

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

    from eventsweep.emvs.geometry.trajectory import Trajectory

Vector3 = tuple[float, float, float]
Array = NDArray[np.float64]
# Of the splines of `CurveMotion`: four continuous derivatives.
_DEGREE = 5


def look_at(
    eye_m: ArrayLike, target_m: ArrayLike, up: ArrayLike = (0, 0, 1)
) -> NDArray[np.float64]:
    """The pose `T_world_body` (4, 4) at `eye_m` whose z axis points at `target_m`, m in the world.

    `up` is the (3,) direction that appears upright in the picture.

    Raises:
        InputError: the target lies at the eye, or straight along `up`.
    """
    eye, target = np.asarray(eye_m, float), np.asarray(target_m, float)
    right = np.cross(target - eye, np.asarray(up, float))
    if np.linalg.norm(right) < 1e-9:
        raise InputError(
            f"cannot look from {eye.tolist()} at {target.tolist()}: the direction must be non-zero "
            f"and not along up={np.asarray(up).tolist()}; move the eye or pass another up"
        )
    forward = (target - eye) / np.linalg.norm(target - eye)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.column_stack([right, np.cross(forward, right), forward, eye])
    return pose


def sampled(motion: Motion, duration_s: float, rate_hz: float) -> Trajectory:
    """Samples `motion` over [0, `duration_s`] at `rate_hz`, both ends included, to a trajectory.

    Times are rounded to the microsecond before the curve is asked, so stored poses are exact.
    """
    from eventsweep.emvs.geometry.trajectory import Trajectory

    duration_us = round(duration_s * 1e6)
    count = max(2, int(np.ceil(duration_us * 1e-6 * rate_hz - 1e-9)) + 1)
    t_us = np.unique(np.rint(np.linspace(0, duration_us, count)).astype(np.int64))
    if isinstance(motion, CurveMotion):
        return Trajectory.from_matrices(t_us, motion.poses(t_us * 1e-6))
    poses = np.stack([motion.T_world_body(t * 1e-6) for t in t_us.tolist()])
    return Trajectory.from_matrices(t_us, poses)


@dataclass(frozen=True)
class Wave:
    """One sinusoid of a head's sway, of the same period in all six directions.

    Amplitudes are right, down, forward in m; pitch (about right), yaw (about down), roll (about
    forward) in degrees; phases have the same order.
    """

    period_s: float
    amplitude_m: Vector3 = (0.0, 0.0, 0.0)
    amplitude_deg: Vector3 = (0.0, 0.0, 0.0)
    phase_rad: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def at(self, t_s: float) -> NDArray[np.float64]:
        """Offset (6,): translation in m, then rotation vector in rad."""
        amplitude = np.array([*self.amplitude_m, *np.radians(self.amplitude_deg)])
        return amplitude * np.sin(2 * np.pi * t_s / self.period_s + np.asarray(self.phase_rad))


@dataclass(frozen=True)
class HeadSway:
    """A head that looks around: sinusoids about a pose at rest, and a steady drift.

    The curve is analytic, so every derivative is smooth, and it stays within the sum of the
    amplitudes of the rest pose, which drifts along its right, down and forward, whatever the phases
    are.
    """

    T_world_rest: NDArray[np.float64]
    waves: tuple[Wave, ...]
    drift_m_s: Vector3 = field(default=(0.0, 0.0, 0.0))

    @classmethod
    def seeded(
        cls, T_world_rest: NDArray[np.float64], amplitude_m: Vector3, amplitude_deg: Vector3,
        periods_s: Sequence[float], seed: int, drift_m_s: Vector3 = (0.0, 0.0, 0.0),
    ) -> HeadSway:  # fmt: skip
        """Draws the phases from `seed`; each further period gets half the amplitude before it."""
        rng = np.random.default_rng(seed)
        waves = []
        for k, period_s in enumerate(periods_s):
            amplitudes = _scaled(amplitude_m, 0.5**k), _scaled(amplitude_deg, 0.5**k)
            phases = tuple(rng.uniform(0, 2 * np.pi, 6).tolist())
            waves.append(Wave(period_s, *amplitudes, phases))
        return cls(T_world_rest, tuple(waves), drift_m_s)

    def T_world_body(self, t_s: float) -> NDArray[np.float64]:
        """Pose (4, 4) at `t_s`."""
        from scipy.spatial.transform import Rotation

        offset = np.zeros(6)
        offset[:3] = np.asarray(self.drift_m_s) * t_s
        offset += sum((wave.at(t_s) for wave in self.waves), np.zeros(6))
        T_rest_body = np.eye(4)
        T_rest_body[:3, :3] = Rotation.from_rotvec(offset[3:]).as_matrix()
        T_rest_body[:3, 3] = offset[:3]
        return np.asarray(self.T_world_rest @ T_rest_body, np.float64)


@dataclass(frozen=True, eq=False)
class Kinematics:
    """(N, 3) each: of the body's origin in world axes, of its turns in body axes."""

    velocity_m_s: Array
    acceleration_m_s2: Array
    angular_velocity_rad_s: Array
    angular_acceleration_rad_s2: Array


@dataclass(frozen=True, eq=False)
class CurveMotion:
    """A motion with four continuous derivatives, over [0, `duration_s`].

    The spline's seven channels are the position in m and a quaternion (x, y, z, w) of any length
    near 1, which is normalised where the curve is asked: a smooth curve on SO(3), without poles.
    `spline` holds value, first and second derivative.
    """

    spline: tuple[BSpline, BSpline, BSpline]
    duration_s: float

    def T_world_body(self, t_s: float) -> Array:
        """Pose (4, 4) at `t_s`."""
        self._check(t_s, t_s)
        x, y, z, i, j, k, w = self.spline[0](t_s).tolist()
        s = 2 / (i * i + j * j + k * k + w * w)
        return np.array(
            [
                [1 - s * (j * j + k * k), s * (i * j - k * w), s * (i * k + j * w), x],
                [s * (i * j + k * w), 1 - s * (i * i + k * k), s * (j * k - i * w), y],
                [s * (i * k - j * w), s * (j * k + i * w), 1 - s * (i * i + j * j), z],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )

    def poses(self, times_s: ArrayLike) -> Array:
        """Poses (N, 4, 4) at (N,) times: many at once, a hundred times faster than one by one."""
        from eventsweep.emvs.geometry import se3

        channels = self.spline[0](self._times(times_s))
        return se3.from_quat_xyzw(channels[:, :3], channels[:, 3:])

    def kinematics(self, times_s: ArrayLike) -> Kinematics:
        """Exact derivatives of the curve at (N,) times.

        With a quaternion q of any length, `omega = 2 vec(q* dq) / |q|^2` in body axes.
        """
        times = self._times(times_s)
        value, first, second = (derivative(times) for derivative in self.spline)
        q, dq, ddq = value[:, 3:], first[:, 3:], second[:, 3:]
        square = np.sum(q * q, axis=1, keepdims=True)
        omega = 2 * _vector_of_conjugate_product(q, dq) / square
        shrink = 2 * np.sum(q * dq, axis=1, keepdims=True) / square
        alpha = 2 * _vector_of_conjugate_product(q, ddq) / square - shrink * omega
        return Kinematics(first[:, :3], second[:, :3], omega, alpha)

    def _times(self, times_s: ArrayLike) -> Array:
        times = np.atleast_1d(np.asarray(times_s, np.float64))
        if times.size:
            self._check(float(times.min()), float(times.max()))
        return times

    def _check(self, first_s: float, last_s: float) -> None:
        if not (first_s >= -1e-9 and last_s <= self.duration_s + 1e-9):
            raise InputError(
                f"pose requested between {first_s} and {last_s} s, but the motion spans 0 to "
                f"{self.duration_s} s: stay within, or make the motion longer"
            )


def curve(times_s: ArrayLike, positions_m: ArrayLike, quats_xyzw: ArrayLike) -> CurveMotion:
    """Interpolates poses at (N,) times, rising from 0, by quintic splines.

    Neighbours of the (N, 4) unit quaternions are less than 90 degrees apart.

    Raises:
        InputError: fewer than six poses, or not finite.
    """
    from scipy.interpolate import make_interp_spline

    times, quats = np.asarray(times_s, float), np.asarray(quats_xyzw, float)
    channels = np.hstack([np.asarray(positions_m, float), _one_hemisphere(quats)])
    if len(times) <= _DEGREE or not np.isfinite(channels).all():
        raise InputError(
            f"{len(times)} poses{'' if np.isfinite(channels).all() else ', some not finite'}: "
            f"a smooth curve needs at least {_DEGREE + 1} finite ones"
        )
    return _with_derivatives(make_interp_spline(times, channels, _DEGREE), float(times[-1]))


def curve_of(motion: Motion, duration_s: float, rate_hz: float = 250.0) -> CurveMotion:
    """The same motion as a `CurveMotion`, through its poses at about `rate_hz`.

    At 250 Hz a 10 Hz sine is met to 1e-6 of its amplitude, its acceleration to 1e-3.
    """
    from eventsweep.emvs.geometry import se3

    if isinstance(motion, CurveMotion) and abs(motion.duration_s - duration_s) < 1e-9:
        return motion
    if not duration_s > 0:
        raise InputError(f"a motion of {duration_s} s: the duration must be positive")
    times = np.linspace(0, duration_s, max(6, int(np.ceil(duration_s * rate_hz)) + 1))
    poses = np.stack([motion.T_world_body(t_s) for t_s in times.tolist()])
    return curve(times, *se3.to_quat_xyzw(poses))


def moved(motion: CurveMotion, T_left: Array, T_right: Array) -> CurveMotion:
    """The curve `T_left @ T_world_body(t) @ T_right`, `T_right` a pure rotation."""
    from scipy.interpolate import BSpline
    from scipy.spatial.transform import Rotation

    left, right = (Rotation.from_matrix(T[:3, :3]).as_quat().tolist() for T in (T_left, T_right))
    matrix = np.zeros((7, 7))
    matrix[:3, :3] = T_left[:3, :3]
    x, y, z, w = left
    to_left = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    x, y, z, w = right
    to_right = np.array([[w, z, -y, x], [-z, w, x, y], [y, -x, w, z], [-x, -y, -z, w]])
    matrix[3:, 3:] = to_left @ to_right  # q -> left q right
    shift = np.concatenate([T_left[:3, 3], np.zeros(4)])
    knots, coefficients, degree = motion.spline[0].tck
    return _with_derivatives(
        BSpline(knots, coefficients @ matrix.T + shift, degree), motion.duration_s
    )


def _with_derivatives(channels: BSpline, duration_s: float) -> CurveMotion:
    return CurveMotion((channels, channels.derivative(1), channels.derivative(2)), duration_s)


def _scaled(vector: Vector3, factor: float) -> Vector3:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor


def _vector_of_conjugate_product(q: Array, r: Array) -> Array:
    """Vector part (N, 3) of the quaternion product q* r, both (N, 4) as x, y, z, w."""
    part: Array = q[:, 3:] * r[:, :3] - r[:, 3:] * q[:, :3] - np.cross(q[:, :3], r[:, :3])
    return part


def _one_hemisphere(quats: Array) -> Array:
    flips = np.sum(quats[1:] * quats[:-1], axis=1) < 0
    signs = np.concatenate([[1.0], np.where(flips, -1.0, 1.0)]).cumprod()
    flipped: Array = quats * signs[:, None]
    return flipped
