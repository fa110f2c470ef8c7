"""Where a body is and how it moves, and how sure that is: constant velocity with white noise.

The errors of pose and twist are those of `T_body_world' = exp(xi) T_body_world` and
`tau' = tau + d_tau`; their covariance grows as in Barfoot, *State Estimation for Robotics* (2017),
section 11.1, with a spectral density that covers the heads of people and small drones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.tables import ImuSamples
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.track.odometry.checkpoint import State

Matrix = NDArray[np.float64]
# Of accelerations: about 5 m/s² and 50 rad/s² that last for a tenth of a second.
_DENSITY = 2.5, 250.0
_STILL_M_S, _STILL_RAD_S = 0.02, 0.05
_NEAR_HEADS_M = 0.5
SIGMA_RAD_S = 0.05
"""Of a rate: noise, a bias that nobody has calibrated, and what lies between two samples."""
_MOST_APART_US = 20_000


@dataclass(frozen=True, eq=False)
class Motion:
    """A pose and a twist at a time.

    Attributes:
        t_us: time, µs.
        T_world_body: (4, 4).
        twist: (6,) of the body in its own frame, m/s and rad/s.
        covariance: (12, 12) of the errors of pose and twist.
        reach: lengths that are expected of motions, over those of a head; see `reach_for`.
    """

    t_us: int
    T_world_body: Matrix
    twist: Matrix
    covariance: Matrix
    reach: float = 1.0

    @classmethod
    def unknown(cls, t_us: int, T_world_body: Matrix, reach: float = 1.0) -> Motion:
        """A pose that says where the world begins, and a motion that may be any head's."""
        sigma = np.repeat([1e-3 * reach, 1e-3, reach, 2.0], 3)
        return cls(t_us, T_world_body, np.zeros(6), np.diag(sigma**2), reach)

    @classmethod
    def near(cls, t_us: int, T_world_body: Matrix, reach: float = 1.0) -> Motion:
        """Somewhere near a pose, moving as any head may."""
        sigma = np.repeat([0.05 * reach, 0.1, reach, 2.0], 3)
        return cls(t_us, T_world_body, np.zeros(6), np.diag(sigma**2), reach)

    def at(self, t_us: int) -> Motion:
        """What is to be expected of another time, before or after."""
        return self._moved(t_us, *self._step(t_us))

    def _moved(self, t_us: int, step: Matrix, F: Matrix) -> Motion:
        """The same by what `_step` says."""
        dt_s = (t_us - self.t_us) * 1e-6
        length_s = abs(dt_s)
        noise = density(self.reach)
        mixed = -noise * dt_s * length_s / 2
        covariance = F @ self.covariance @ F.T
        covariance[:6, :6] += noise * length_s**3 / 3
        covariance[:6, 6:] += mixed
        covariance[6:, :6] += mixed
        covariance[6:, 6:] += noise * length_s
        return replace(
            self, t_us=t_us, T_world_body=self.T_world_body @ step, covariance=covariance
        )

    def _step(self, t_us: int) -> tuple[Matrix, Matrix]:
        """The way to another time (4, 4), and what that makes of errors (12, 12)."""
        dt_s = (t_us - self.t_us) * 1e-6
        step, F = se3.exp(self.twist * dt_s), np.eye(12)
        F[:6, :6] = se3.adjoint(se3.inverse(step))
        F[:6, 6:] = -dt_s * np.eye(6)
        return step, F

    def given(self, later: Motion) -> Motion:
        """The motion once a later one is known, found from this one and all since.

        A step of the smoother of Rauch, Tung and Striebel (1965).
        """
        step, F = self._step(later.t_us)
        expected = self._moved(later.t_us, step, F)
        xi = se3.log(se3.inverse(later.T_world_body) @ expected.T_world_body)
        off = np.concatenate([xi, later.twist - expected.twist])
        gain = np.linalg.solve(expected.covariance, F @ self.covariance).T
        change = gain @ off
        T_world_body = self.T_world_body @ se3.inverse(se3.exp(change[:6]))
        covariance = self.covariance + gain @ (later.covariance - expected.covariance) @ gain.T
        return replace(
            self, T_world_body=se3.nearest_rigid(T_world_body), twist=self.twist + change[6:],
            covariance=(covariance + covariance.T) / 2,
        )  # fmt: skip

    def turning(self, rate_rad_s: Matrix, sigma_rad_s: float) -> Motion:
        """The motion once a gyroscope has said how fast the body turns: a Kalman update.

        The pose is corrected, too, as far as its error goes with that of the rate.
        """
        seen = self.covariance[:, 9:]
        gain = np.linalg.solve(seen[9:] + sigma_rad_s**2 * np.eye(3), seen.T).T
        change = gain @ (rate_rad_s - self.twist[3:])
        T_world_body = self.T_world_body @ se3.inverse(se3.exp(change[:6]))
        covariance = self.covariance - gain @ seen.T
        return replace(
            self, T_world_body=T_world_body, twist=self.twist + change[6:], covariance=covariance
        )

    def surprise(self, expected: Motion) -> float:
        """How far it is from what was expected: the square of it in standard deviations."""
        xi = se3.log(se3.inverse(expected.T_world_body) @ self.T_world_body)
        off = np.concatenate([xi, self.twist - expected.twist])
        return float(off @ np.linalg.solve(expected.covariance, off))

    def unsettled(self) -> Motion:
        """The same place, and nothing known of how the body moves from there."""
        unknown = Motion.unknown(self.t_us, self.T_world_body, self.reach)
        unknown.covariance[:6, :6] = self.covariance[:6, :6]
        return unknown

    def held(self, t_us: int) -> Motion:
        """The body standing where it is, at another time."""
        covariance = np.zeros((12, 12))
        covariance[:6, :6] = self.covariance[:6, :6]
        covariance[6:, 6:] = np.diag(np.repeat([_STILL_M_S, _STILL_RAD_S], 3) ** 2)
        return replace(self, t_us=t_us, twist=np.zeros(6), covariance=covariance)

    def seen_from(self, T_new_world: Matrix) -> Motion:
        """The motion in another world frame."""
        return replace(self, T_world_body=T_new_world @ self.T_world_body)


def smoothed_motions(beliefs: Sequence[Motion | None]) -> list[Motion | None]:
    """Motions as those after them say, too, as far as one filter led from each to the next."""
    done: list[Motion | None] = []
    later: Motion | None = None
    for here in reversed(beliefs):
        later = here if here is None or later is None else here.given(later)
        done.append(later)
    return done[::-1]


def trajectory_of(motions: Sequence[Motion]) -> Trajectory:
    """Motions as poses."""
    poses = np.stack([motion.T_world_body for motion in motions])
    return Trajectory.from_matrices([motion.t_us for motion in motions], poses)


def density(reach: float) -> Matrix:
    """The (6, 6) spectral density of the noise of accelerations, m²/s³ and rad²/s³."""
    way, turn = _DENSITY
    return np.diag(np.repeat([way * reach**2, turn], 3))


def reach_for(near_m: float) -> float:
    """How much faster than heads bodies move whose surroundings begin so far away.

    What moves by so many pixels moves the faster the farther that is: a car sees nothing near.
    """
    return max(1.0, near_m / _NEAR_HEADS_M)


class Gyroscope:
    """Rates of turn of the body, in its own frame; a bounded stretch of them."""

    def __init__(self) -> None:
        self._t_us = np.empty(0, np.int64)
        self._rates = np.empty((0, 3))

    def __len__(self) -> int:
        return len(self._t_us)

    def push(self, samples: ImuSamples) -> None:
        """Takes samples that are later than all before.

        Raises:
            InputError: out of order.
        """
        t_us = np.concatenate([self._t_us, samples.t_us])
        if not (np.diff(t_us[max(len(self) - 1, 0) :]) > 0).all():
            raise InputError(
                f"inertial samples from {samples.t_us[0]} µs: times must increase, and be later "
                "than those already pushed"
            )
        self._t_us = t_us
        rates = samples.gyro_rad_s @ samples.T_body_imu[:3, :3].T
        self._rates = np.concatenate([self._rates, rates])

    def state(self) -> State:
        """The samples that are there."""
        return {"t_us": self._t_us, "rates": self._rates}

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        self._t_us, self._rates = state["t_us"], state["rates"]

    def drop_before(self, t_us: int) -> None:
        """Lets go of older samples."""
        k = int(np.searchsorted(self._t_us, t_us))
        self._t_us, self._rates = self._t_us[k:], self._rates[k:]

    def rate_at(self, t_us: int, known_us: int) -> Matrix | None:
        """The rate (3,) at a time by the samples before `known_us`, rad/s; None in a gap."""
        k = int(np.searchsorted(self._t_us, t_us, side="right"))
        last = int(np.searchsorted(self._t_us, known_us))
        around = slice(max(k - 1, 0), min(k + 1, last))
        times, rates = self._t_us[around], self._rates[around]
        if not len(times) or np.abs(times - t_us).max() > _MOST_APART_US:
            return None
        return np.array([np.interp(t_us, times, column) for column in rates.T])
