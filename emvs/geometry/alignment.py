"""The rigid motion, or the similarity, that aligns points with others by least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_LINE = 1e-8
"""Singular values below this share of the largest one: the points lie on a line, or in one place.

It is about the square of how wide they spread beside the line over how far along it."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """Maps points of frame b into frame a: `p_a = scale * R_a_b @ p_b + t_a`.

    Attributes:
        scale: how many units of frame a are one of frame b; 1 for a rigid motion.
        R_a_b: (3, 3) rotation.
        t_a_m: (3,) where the origin of b lies in a, m.
        is_unique: False where other rotations fit as well: the points lie on a line.
    """

    scale: float
    R_a_b: Floats
    t_a_m: Floats
    is_unique: bool = True

    @classmethod
    def identity(cls) -> Similarity:
        """Leaves everything where it is."""
        return cls(1.0, np.eye(3), np.zeros(3))

    def points(self, points_b_m: Floats) -> Floats:
        """Maps (..., 3) points of frame b into frame a, m."""
        moved: Floats = self.scale * points_b_m @ self.R_a_b.T + self.t_a_m
        return moved

    def poses(self, T_b_body: Floats) -> Floats:
        """Maps (..., 4, 4) poses `T_b_body` to `T_a_body`: only positions are scaled."""
        T_a_body = T_b_body.copy()
        T_a_body[..., :3, :3] = self.R_a_b @ T_b_body[..., :3, :3]
        T_a_body[..., :3, 3] = self.points(T_b_body[..., :3, 3])
        return T_a_body


def align_points(points_a_m: Floats, points_b_m: Floats, *, with_scale: bool = False) -> Similarity:
    """Finds the motion that minimises `sum |p_a - (scale * R_a_b @ p_b + t_a)|²`.

    The closed form of Umeyama (PAMI 13, 1991), eqs. 34 to 43. Points in one place leave the
    rotation the identity and the scale 1.

    Args:
        points_a_m: (N, 3) points in frame a, m.
        points_b_m: (N, 3) the same points in frame b, m.
        with_scale: whether the scale is free; else it is 1.
    """
    mean_a, mean_b = points_a_m.mean(axis=0), points_b_m.mean(axis=0)
    centred_a, centred_b = points_a_m - mean_a, points_b_m - mean_b
    U, singular, Vt = np.linalg.svd(centred_a.T @ centred_b / len(points_a_m))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    R_a_b = U * signs @ Vt
    variance_b = float(np.mean(np.sum(centred_b**2, axis=1)))
    scale = float(singular @ signs) / variance_b if with_scale and variance_b > 0 else 1.0
    is_unique = bool(singular[1] > _LINE * singular[0])
    return Similarity(scale, R_a_b, mean_a - scale * R_a_b @ mean_b, is_unique)
