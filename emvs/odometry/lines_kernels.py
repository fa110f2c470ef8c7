"""Compiled loops of line fields: moments of points in the image, and points of a map in a camera.

Motions are (4, 4) float64 matrices; `intrinsics` is (4,) float64 fx, fy, cx, cy of a pinhole, px.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

NEAREST_M = 0.05  # what is nearer to a camera is behind it, or too near to be sharp


@njit(cache=True, nogil=True)
def moved(T, x, y, z):
    """A point, carried by a rigid motion."""
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
    )


@njit(cache=True, nogil=True)
def project(points, T_cam_world, intrinsics, size, out):
    """Fills rows (u, v, inverse depth) of `out` with the points in view; returns how many."""
    n = 0
    for k in range(len(points)):
        x, y, z = moved(T_cam_world, points[k, 0], points[k, 1], points[k, 2])
        if z < NEAREST_M:
            continue
        u = intrinsics[0] * x / z + intrinsics[2]
        v = intrinsics[1] * y / z + intrinsics[3]
        if u >= 0 and v >= 0 and u <= size[0] - 1 and v <= size[1] - 1:
            out[n, 0], out[n, 1], out[n, 2] = u, v, 1 / z
            n += 1
    return n


@njit(cache=True, nogil=True)
def add_moments(points, count, cell_px, out):
    """Adds 1, a, b, aa, ab, bb, rho of each (u, v, rho) at its cell of `out`, (h, w, 7) float32.

    Cells have their middles at multiples of `cell_px`; a, b is the place from the image's middle.
    """
    rows, columns = out.shape[:2]
    u_mid, v_mid = 0.5 * cell_px * columns, 0.5 * cell_px * rows
    for k in range(count):
        u, v = points[k, 0], points[k, 1]
        i, j = int(u / cell_px + 0.5), int(v / cell_px + 0.5)
        if i >= columns or j >= rows:
            continue
        a, b = u - u_mid, v - v_mid
        out[j, i, 0] += 1
        out[j, i, 1] += a
        out[j, i, 2] += b
        out[j, i, 3] += a * a
        out[j, i, 4] += a * b
        out[j, i, 5] += b * b
        out[j, i, 6] += points[k, 2]


@njit(cache=True, nogil=True)
def line_at(moments, cell_px, least, u, v):
    """The line near a place in the image, from blurred moments: weight, n_u, n_v, c, rho.

    The line is n . (u, v) = c; the weight is 0 where there is none, and 1 where points lie on it
    exactly.
    """
    rows, columns = moments.shape[:2]
    i, j = int(u / cell_px + 0.5), int(v / cell_px + 0.5)
    if not (u >= 0 and v >= 0 and i < columns and j < rows):
        return 0.0, 0.0, 0.0, 0.0, 0.0
    mass = float(moments[j, i, 0])
    if mass < least:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    a, b = moments[j, i, 1] / mass, moments[j, i, 2] / mass
    var_a = moments[j, i, 3] / mass - a * a
    var_ab = moments[j, i, 4] / mass - a * b
    var_b = moments[j, i, 5] / mass - b * b
    half, mean = 0.5 * (var_a - var_b), 0.5 * (var_a + var_b)
    length = np.sqrt(half * half + var_ab * var_ab)
    if length < 1e-6:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    # The line runs along the major axis, at half the angle of (half, var_ab).
    along_u = np.sqrt(max(0.5 * (1 + half / length), 0.0))
    along_v = 1.0 if along_u < 1e-6 else 0.5 * var_ab / length / along_u
    n_u, n_v = -along_v, along_u
    c = n_u * (a + 0.5 * cell_px * columns) + n_v * (b + 0.5 * cell_px * rows)
    weight = (length / (mean + 0.05)) ** 2
    return weight, n_u, n_v, c, moments[j, i, 6] / mass


@njit(cache=True, nogil=True)
def add_inverse_depth(points, count, cell_px, total, number):
    """Adds each point's inverse depth, and 1, at its cell."""
    rows, columns = total.shape
    for k in range(count):
        i, j = int(points[k, 0] / cell_px + 0.5), int(points[k, 1] / cell_px + 0.5)
        if i < columns and j < rows:
            total[j, i] += points[k, 2]
            number[j, i] += 1
