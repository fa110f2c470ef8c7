"""Rigid motions as (..., 4, 4) matrices, frames in their names: `p_a = T_a_b @ p_b`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Matrix = NDArray[np.float64]


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


def is_rigid(T_a_b: Matrix, tolerance: float = 1e-6) -> bool:
    """Whether a (4, 4) matrix is a rotation and a translation, to `tolerance`."""
    R = T_a_b[:3, :3]
    return bool(
        T_a_b.shape == (4, 4)
        and np.all(np.isfinite(T_a_b))
        and np.allclose(R @ R.T, np.eye(3), atol=tolerance)
        and np.linalg.det(R) > 0
        and np.allclose(T_a_b[3], [0, 0, 0, 1])
    )
