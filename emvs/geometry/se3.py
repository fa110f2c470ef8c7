"""Rigid motions as (..., 4, 4) matrices, frames in their names: `p_a = T_a_b @ p_b`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Matrix = NDArray[np.float64]
# As `np.allclose` has it, which takes ten times as long.
_UNIT, _RELATIVE = np.eye(4), 1e-5
ROUNDED = 1e-3
"""How far the rows of a rotation that was rounded to four decimals may be from orthonormal."""
_SMALL_ANGLE = 1e-3  # rad: below it series are more precise


def from_rotation(rotation: Rotation, position_m: ArrayLike) -> Matrix:
    """Builds (..., 4, 4) from rotations and (..., 3) positions in metres."""
    position = np.asarray(position_m, np.float64)
    T_a_b = np.zeros((*position.shape[:-1], 4, 4))
    T_a_b[..., :3, :3] = rotation.as_matrix()
    T_a_b[..., :3, 3] = position
    T_a_b[..., 3, 3] = 1
    return T_a_b


def from_quat_xyzw(position_m: ArrayLike, quat_xyzw: ArrayLike) -> Matrix:
    """Builds (..., 4, 4) from (..., 3) positions in metres and (..., 4) quaternions."""
    return from_rotation(Rotation.from_quat(np.asarray(quat_xyzw, np.float64)), position_m)


def to_quat_xyzw(T_a_b: Matrix) -> tuple[Matrix, Matrix]:
    """Splits (..., 4, 4) into (..., 3) positions in metres and (..., 4) quaternions, w >= 0."""
    quat_xyzw = Rotation.from_matrix(T_a_b[..., :3, :3]).as_quat(canonical=True)
    return T_a_b[..., :3, 3].copy(), quat_xyzw


def inverse(T_a_b: Matrix) -> Matrix:
    """Inverts rigid motions (..., 4, 4): `T_b_a`."""
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    T_b_a = np.zeros_like(T_a_b)
    T_b_a[..., :3, :3] = R_b_a
    T_b_a[..., :3, 3] = -np.einsum("...ij,...j->...i", R_b_a, T_a_b[..., :3, 3])
    T_b_a[..., 3, 3] = 1
    return T_b_a


def transform(T_a_b: Matrix, points_b: ArrayLike) -> Matrix:
    """Maps (..., 3) points of frame b into frame a with one (4, 4) motion."""
    points = np.asarray(points_b, np.float64)
    moved: Matrix = points @ T_a_b[:3, :3].T + T_a_b[:3, 3]
    return moved


def transform_each(T_a_b: Matrix, points_b: Matrix) -> Matrix:
    """Maps (N, 3) points of frame b into frame a, each with its own motion of (N, 4, 4)."""
    turned = np.einsum("nij,nj->ni", T_a_b[:, :3, :3], points_b)
    return np.asarray(turned + T_a_b[:, :3, 3], np.float64)


@np.errstate(over="ignore", invalid="ignore")
def is_rigid(T_a_b: Matrix, tolerance: float = 1e-6) -> bool:
    """Whether a (4, 4) matrix is a rotation and a translation, to `tolerance`."""
    R = T_a_b[:3, :3]
    return bool(
        T_a_b.shape == (4, 4)
        and np.all(np.isfinite(T_a_b))
        and (np.abs(R @ R.T - _UNIT[:3, :3]) <= tolerance + _RELATIVE * _UNIT[:3, :3]).all()
        and np.linalg.det(R) > 0
        and (np.abs(T_a_b[3] - _UNIT[3]) <= 1e-8 + _RELATIVE * _UNIT[3]).all()
    )


@np.errstate(over="ignore", invalid="ignore")
def fault(T_a_b: Matrix, tolerance: float = 1e-6) -> str:
    """Why `is_rigid` refuses a matrix, with the amount and the limit; empty where it does not."""
    if T_a_b.shape != (4, 4):
        return f"it has shape {T_a_b.shape}"
    if not np.isfinite(T_a_b).all():
        return "a number in it is not finite"
    if is_rigid(T_a_b, tolerance):
        return ""
    R = T_a_b[:3, :3]
    off = float(np.abs(R @ R.T - _UNIT[:3, :3]).max())
    if off > tolerance:
        return f"R R^T differs from 1 by {off:.2g}, at most {tolerance:g} is rounding"
    mirrored = np.linalg.det(R) < 0
    return "its rotation is mirrored" if mirrored else f"its last row is {T_a_b[3].tolist()}"


def nearest_rigid(T_a_b: Matrix) -> Matrix:
    """The rigid motion nearest to a (4, 4) matrix that is one but for rounding errors."""
    left, _, right = np.linalg.svd(T_a_b[:3, :3])
    rigid = T_a_b.copy()
    rigid[:3, :3] = left @ right
    return rigid


def exp(xi: ArrayLike) -> Matrix:
    """The motion (4, 4) of a twist (6,), m then rad, that acts for a unit of time."""
    twist = np.asarray(xi, np.float64)
    angle = float(np.linalg.norm(twist[3:]))
    W = _cross(twist[3:])
    if angle > _SMALL_ANGLE:
        a, b = np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2
        c = (angle - np.sin(angle)) / angle**3
    else:
        a, b, c = 1 - angle**2 / 6, 0.5 - angle**2 / 24, 1 / 6 - angle**2 / 120
    W2 = W @ W
    T_a_b = np.eye(4)
    T_a_b[:3, :3] += a * W + b * W2
    T_a_b[:3, 3] = twist[:3] + b * (W @ twist[:3]) + c * (W2 @ twist[:3])
    return T_a_b


def log(T_a_b: Matrix) -> Matrix:
    """The twist (6,), m then rad, of a motion (4, 4) whose turn is less than half a turn."""
    turn = _turn(T_a_b[:3, :3])
    angle = float(np.linalg.norm(turn))
    W = _cross(turn)
    if angle > _SMALL_ANGLE:
        c = (1 - angle * np.sin(angle) / (2 * (1 - np.cos(angle)))) / angle**2
    else:
        c = 1 / 12 + angle**2 / 720
    position = T_a_b[:3, 3]
    way: Matrix = position - 0.5 * (W @ position) + c * (W @ (W @ position))
    return np.concatenate([way, turn])


def _turn(R: Matrix) -> Matrix:
    """The rotation vector (3,) of a rotation."""
    sine = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    length = float(np.linalg.norm(sine))
    if length > 0.5 or R[0, 0] + R[1, 1] + R[2, 2] < 1:  # above 30°, where arcsin loses digits
        found: Matrix = Rotation.from_matrix(R).as_rotvec()
        return found
    scale = np.arcsin(length) / length if length > _SMALL_ANGLE else 1 + length**2 / 6
    return scale * sine


def adjoint(T_a_b: Matrix) -> Matrix:
    """The (6, 6) matrix that turns a twist of frame b, (v, w), into that of frame a."""
    R, p = T_a_b[:3, :3], T_a_b[:3, 3]
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = adjoint[3:, 3:] = R
    adjoint[:3, 3:] = _cross(p) @ R
    return adjoint


def _cross(w: Matrix) -> Matrix:
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
