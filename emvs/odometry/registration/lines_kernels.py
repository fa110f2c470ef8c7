"""Compiled loops of line fields: points in cells of the image, and the lines that they lie on.

Motions are (4, 4) float64 matrices; `intrinsics` is (4,) float64 fx, fy, cx, cy of a pinhole, px.

A field is a tuple of flat arrays over the cells of all images:

    filled: (N,) int32, the drawing that last put a point into the cell.
    sums: (N, 7) float32, of its points: 1, a, b, aa, ab, bb, rho; a, b from its middle, px.
    made: (N,) int32, the drawing that the cell's line is of.
    lines: (N, 5) float32, weight, n_u, n_v, distance of the line from the cell's middle, rho.

`place` is (4,) int64 of one image: its first cell, rows, columns, and the size of a cell, px.
`drawing` is a number that rises: what is of an earlier one is not there, and nothing is cleared.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

NEAREST_M = 0.05  # what is nearer to a camera is behind it, or too near to be sharp
REACH = 3
"""Cells to each side whose points make a cell's line."""
LEAST = 0.15
"""Mass below which there is no line, in a Gaussian's middle: about half a point per pixel of it."""
_SIGMA_CELLS = 1.2
_BELL = np.exp(-0.5 * (np.arange(REACH + 1) / _SIGMA_CELLS) ** 2)
_BELL /= _BELL[0] + 2 * _BELL[1:].sum()


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
def add_points(points, count, place, drawing, field):
    """Adds (u, v, rho) points to their cells; the middles lie at multiples of a cell's size."""
    filled, sums = field[0], field[1]
    first, rows, columns, cell_px = place
    for k in range(count):
        u, v = points[k, 0], points[k, 1]
        i, j = int(u / cell_px + 0.5), int(v / cell_px + 0.5)
        if i >= columns or j >= rows:
            continue
        q, a, b = first + j * columns + i, u - i * cell_px, v - j * cell_px
        if filled[q] != drawing:
            filled[q] = drawing
            sums[q] = 0
        sums[q, 0] += 1
        sums[q, 1] += a
        sums[q, 2] += b
        sums[q, 3] += a * a
        sums[q, 4] += a * b
        sums[q, 5] += b * b
        sums[q, 6] += points[k, 2]


@njit(cache=True, nogil=True)
def _fit(place, drawing, field, i, j):
    """Makes the line of cell (i, j) from the points around it, weighted by a Gaussian."""
    filled, sums, _, lines = field
    first, rows, columns, cell_px = place
    line = lines[first + j * columns + i]
    line[0] = 0
    mass = sum_a = sum_b = sum_aa = sum_ab = sum_bb = sum_rho = 0.0
    for row in range(max(j - REACH, 0), min(j + REACH + 1, rows)):
        b, down = float((row - j) * cell_px), _BELL[abs(row - j)]
        for column in range(max(i - REACH, 0), min(i + REACH + 1, columns)):
            q = first + row * columns + column
            if filled[q] != drawing:
                continue
            a, w = float((column - i) * cell_px), down * _BELL[abs(column - i)]
            n, own_a, own_b = sums[q, 0], sums[q, 1], sums[q, 2]
            mass += w * n
            sum_a += w * (own_a + n * a)
            sum_b += w * (own_b + n * b)
            sum_aa += w * (sums[q, 3] + 2 * a * own_a + n * a * a)
            sum_ab += w * (sums[q, 4] + a * own_b + b * own_a + n * a * b)
            sum_bb += w * (sums[q, 5] + 2 * b * own_b + n * b * b)
            sum_rho += w * sums[q, 6]
    if mass < LEAST * cell_px:
        return
    a, b = sum_a / mass, sum_b / mass
    var_a, var_ab, var_b = sum_aa / mass - a * a, sum_ab / mass - a * b, sum_bb / mass - b * b
    half, mean = 0.5 * (var_a - var_b), 0.5 * (var_a + var_b)
    length = np.sqrt(half * half + var_ab * var_ab)
    if length < 1e-6:
        return
    # The line runs along the major axis, at half the angle of (half, var_ab).
    along_u = np.sqrt(max(0.5 * (1 + half / length), 0.0))
    along_v = 1.0 if along_u < 1e-6 else 0.5 * var_ab / length / along_u
    line[0] = (length / (mean + 0.05)) ** 2
    line[1], line[2] = -along_v, along_u
    line[3], line[4] = along_u * b - along_v * a, sum_rho / mass


@njit(cache=True, nogil=True)
def line_at(place, drawing, field, u, v):
    """The line near a place in the image: weight, n_u, n_v, distance of the place from it, rho.

    The place less the distance times the normal n lies on the line; the weight is 0 where there is
    no line, and 1 where points lie on it exactly. A cell's line is made when it is first looked up.
    """
    first, rows, columns, cell_px = place
    i, j = int(u / cell_px + 0.5), int(v / cell_px + 0.5)
    if not (u >= 0 and v >= 0 and i < columns and j < rows):
        return 0.0, 0.0, 0.0, 0.0, 0.0
    q = first + j * columns + i
    if field[2][q] != drawing:
        field[2][q] = drawing
        _fit(place, drawing, field, i, j)
    line = field[3][q]
    n_u, n_v = float(line[1]), float(line[2])
    off = n_u * (u - i * cell_px) + n_v * (v - j * cell_px) - line[3]
    return float(line[0]), n_u, n_v, off, float(line[4])


@njit(cache=True, nogil=True)
def add_inverse_depth(points, count, cell_px, total, number):
    """Adds each point's inverse depth, and 1, at its cell."""
    rows, columns = total.shape
    for k in range(count):
        i, j = int(points[k, 0] / cell_px + 0.5), int(points[k, 1] / cell_px + 0.5)
        if i < columns and j < rows:
            total[j, i] += points[k, 2]
            number[j, i] += 1
