"""A trajectory: timed poses, interpolated on SE(3), never extrapolated."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.errors import InputError, check_array, shown
from eventsweep.emvs.geometry import se3

_UNIT_TOLERANCE = 1e-3
MOST_M = 1e12
"""More than any position; what is larger has no sum of squares to reckon with."""


class PoseSource(Protocol):
    """Says where a body was: a recorded trajectory, or a tracker that learns it as it goes."""

    def known(self) -> Trajectory:
        """The poses known so far."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of one body in the world.

    Attributes:
        t_us: (N,) int64, strictly increasing, µs.
        positions_m: (N, 3) float64.
        quats_xyzw: (N, 4) float64 unit quaternions; neighbours lie in one hemisphere.
        notes: what a reader must know of the file that they are from, a sentence each.

    Raises:
        InputError: no poses, NaN, a quaternion that is not of unit length, or time not increasing.
    """

    t_us: NDArray[np.int64]
    positions_m: NDArray[np.float64]
    quats_xyzw: NDArray[np.float64]
    notes: tuple[str, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        check_array("trajectory's t_us", self.t_us, "an array (N,) of whole µs", "iu")
        for name, columns in (("positions_m", 3), ("quats_xyzw", 4)):
            needed = f"an array (N, {columns}) of numbers"
            check_array(f"trajectory's {name}", getattr(self, name), needed, "iuf")
        n = len(self.t_us)
        shapes = self.t_us.shape, self.positions_m.shape, self.quats_xyzw.shape
        if n < 1 or shapes != ((n,), (n, 3), (n, 4)):
            raise InputError(
                f"trajectory of {n} times, positions {self.positions_m.shape}, quaternions "
                f"{self.quats_xyzw.shape}: needs (N,), (N, 3) and (N, 4) with N >= 1"
            )
        _check_values(self.t_us, self.positions_m, self.quats_xyzw)
        object.__setattr__(self, "quats_xyzw", _one_hemisphere(self.quats_xyzw))

    @classmethod
    def from_matrices(cls, t_us: ArrayLike, T_world_body: NDArray[np.float64]) -> Trajectory:
        """Builds a trajectory from (N,) times in µs and (N, 4, 4) poses.

        Raises:
            InputError: other shapes, or what the class itself refuses.
        """
        check_array("T_world_body", T_world_body, "an array (N, 4, 4)", "iuf")
        if T_world_body.shape[1:] != (4, 4):
            raise InputError(f"T_world_body of shape {T_world_body.shape}: needs (N, 4, 4)")
        positions_m, quats_xyzw = se3.to_quat_xyzw(T_world_body)
        return cls(np.asarray(t_us, np.int64), positions_m, quats_xyzw)

    def known(self) -> Trajectory:
        """All of it: a recorded trajectory does not grow."""
        return self

    def __len__(self) -> int:
        return len(self.t_us)

    def __repr__(self) -> str:
        first_us, last_us = self.span_us
        way_m = np.linalg.norm(np.diff(self.positions_m, axis=0), axis=1).sum()
        return f"Trajectory({len(self)} poses, {first_us} to {last_us} µs, a way of {way_m:.3g} m)"

    @property
    def span_us(self) -> tuple[int, int]:
        """Times of the first and the last pose, both included."""
        return int(self.t_us[0]), int(self.t_us[-1])

    def at(self, t_us: ArrayLike) -> NDArray[np.float64]:
        """Interpolates: rotation along the great arc, position along the line.

        Args:
            t_us: (...) times, µs.

        Returns:
            (..., 4, 4) poses `T_world_body`.

        Raises:
            InputError: a time outside the span; says by how much.
        """
        times = np.asarray(t_us)
        if times.dtype.kind not in "iuf":
            raise InputError(f"time {shown(t_us)}: needs µs")
        self._check_covers(times)
        left = np.clip(
            np.searchsorted(self.t_us, times, side="right") - 1, 0, max(len(self) - 2, 0)
        )
        right = np.minimum(left + 1, len(self) - 1)
        length = np.maximum(self.t_us[right] - self.t_us[left], 1)
        share = ((times - self.t_us[left]) / length)[..., None]
        position_m = (1 - share) * self.positions_m[left] + share * self.positions_m[right]
        rotation_left = Rotation.from_quat(self.quats_xyzw[left])
        turn = (rotation_left.inv() * Rotation.from_quat(self.quats_xyzw[right])).as_rotvec()
        return se3.from_rotation(rotation_left * Rotation.from_rotvec(share * turn), position_m)

    def times(self, T_body_other: NDArray[np.float64]) -> Trajectory:
        """The trajectory of another frame on the same body: `T_world_body @ T_body_other`."""
        T_world_body = se3.from_quat_xyzw(self.positions_m, self.quats_xyzw)
        moved = Trajectory.from_matrices(self.t_us, T_world_body @ T_body_other)
        return replace(moved, notes=self.notes)

    def _check_covers(self, times_us: NDArray[np.generic]) -> None:
        if times_us.size == 0:
            return
        first, last = self.span_us
        early, late = first - int(times_us.min()), int(times_us.max()) - last
        if early > 0 or late > 0:
            by = f"{early} µs before the first" if early > 0 else f"{late} µs after the last"
            raise InputError(
                f"pose requested {by} pose ({first}..{last} µs): poses are never extrapolated, "
                "choose a time inside"
            )


@np.errstate(over="ignore")  # what is too large is refused below
def _check_values(
    t_us: NDArray[np.int64], positions_m: NDArray[np.float64], quats_xyzw: NDArray[np.float64]
) -> None:
    bad = ~np.isfinite(np.hstack([positions_m, quats_xyzw])).all(axis=1)
    if bad.any():
        raise InputError(
            f"pose {int(np.argmax(bad))} is not finite: remove it ({bad.sum()} such poses)"
        )
    far = np.abs(positions_m).max(axis=1) > MOST_M
    if far.any():
        k = int(np.argmax(far))
        raise InputError(
            f"pose {k} is {np.abs(positions_m[k]).max():.4g} m away, at most {MOST_M:g}: "
            "needs positions in metres"
        )
    norms = np.linalg.norm(quats_xyzw, axis=1)
    bad = np.abs(norms - 1) > _UNIT_TOLERANCE
    if bad.any():
        k = int(np.argmax(bad))
        raise InputError(
            f"pose {k}: quaternion of length {norms[k]:.4f}, must be 1 ({bad.sum()} such poses): "
            "check the column order (x y z w)"
        )
    backwards = np.flatnonzero(np.diff(t_us) <= 0)
    if backwards.size:
        k = int(backwards[0]) + 1
        raise InputError(
            f"pose {k} at {t_us[k]} µs does not come after {t_us[k - 1]} µs: "
            "sort the poses and remove repeated times"
        )


def _one_hemisphere(quats_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternions with non-negative dot product between neighbours."""
    unit = quats_xyzw / np.linalg.norm(quats_xyzw, axis=1, keepdims=True)
    flips = np.sum(unit[1:] * unit[:-1], axis=1) < 0
    signs = np.concatenate([[1.0], np.where(flips, -1.0, 1.0)]).cumprod()
    flipped: NDArray[np.float64] = unit * signs[:, None]
    return flipped
