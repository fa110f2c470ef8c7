"""Compiled loops of line fields: points in cells of the image, and the lines that they lie on.

Motions are (4, 4) float64 matrices; `intrinsics` is (4,) float64 fx, fy, cx, cy of a pinhole, px.

A field is a tuple of flat arrays over the cells of all images:

    sums: (8 N + 16,) float32, from number 16 k on those of the k-th pair of cells that holds
        points, 8 of each cell's: 1, a, b, aa, ab, bb, q, 1; a, b from its middle, in cells.
    filled: (N / 2 + 1,) int32, how many pairs hold points, then which.
    slots: (N / 2,) int32, k of each pair, 0 of one that holds none.
    made: (N,) int32, the drawing that the cell's line is of.
    lines: (N, 6) float32, weight, n_u, n_v, distance of the line from the cell's middle, px, mean
        of q, and its covariance with the distance across the line over that one's deviation.
    scratch: (48,) float32.

What a point carries besides its place, q, is its inverse depth in a map. Of an event it is its time
over the standard deviation of all, or 0: then the last number is the correlation of time with the
distance across the line. The expected motion of the rig is taken out of events before, so edges at
rest stay where they are, at any depth, and it is about 0; of a body that moves by itself they
drift.

Sums lie side by side in the order in which cells were filled: edges fill one cell in twenty, and
theirs stay in a core's cache, as those of all cells would not. A pair is one line of it.

`place` is (4,) int64 of one image: its first cell, rows, columns, an even number, and the size of a
cell, px. Each row is followed by `MARGIN` cells more, and there are `REACH` empty rows above and
below: cells out of the image are read like all others. `drawing` is a number that rises: lines of
an earlier one are not there.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg, var-annotated"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.utils.vectors_kernels import WIDTH, load, plus, splat, store

NEAREST_M = 0.05  # what is nearer to a camera is behind it, or too near to be sharp
REACH = 3
"""Cells to each side whose points make a cell's line."""
LEAST = 0.15
"""Mass below which there is no line, in a Gaussian's middle: about half a point per pixel of it."""
_SIGMA_CELLS = 1.2
_PIXEL = 0.1  # px², about the variance of places that are rounded to pixels
MARGIN = REACH + 1
"""Cells behind each row of an image: as many as whole pairs around its last one reach."""
SUMS = 8
"""Numbers of a cell."""
_PAIR = 2 * SUMS
_ROW = _PAIR * (REACH + 1)
_TABLE = _ROW * (2 * REACH + 1)
_ONE = np.float32(1)


def _weights():
    """What multiplies the sums of the cells around: three tables of 7 rows of 4 pairs, flat.

    Moments about the middle of the cell in question follow from those about each cell's own: with
    weights w, and the cell (a, b) cells away, of the first table come the sums of w and of w a b,
    of the others those of w a and w a², and of w b and w b²; of q, those of w a and w b alone: as
    if it lay in its cell's middle. Each stands there twice: the pairs begin 3 cells before the one
    in question, or 4.
    """
    tables = np.zeros((3, 2, 2 * REACH + 1, 2 * MARGIN, SUMS))
    for before, (plain, aside, down) in enumerate(tables.swapaxes(0, 1), REACH):
        b, a = np.mgrid[-REACH : REACH + 1, -before : 2 * MARGIN - before].astype(np.float64)
        w = np.exp(-0.5 * (a * a + b * b) / _SIGMA_CELLS**2) * (np.abs(a) <= REACH)
        w /= w.sum()
        plain[..., :7], plain[..., 7] = w[..., None], w * a * b
        aside[..., :3], aside[..., 6], aside[..., 7] = (w * a)[..., None], w * a, w * a * a
        down[..., :3], down[..., 6], down[..., 7] = (w * b)[..., None], w * b, w * b * b
    return tables.astype(np.float32).reshape(3, -1)


_PLAIN, _ASIDE, _DOWN = _weights()


@njit(cache=True, nogil=True, forceinline=True)
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
        inverse = 1 / z
        u = intrinsics[0] * x * inverse + intrinsics[2]
        v = intrinsics[1] * y * inverse + intrinsics[3]
        if u >= 0 and v >= 0 and u <= size[0] - 1 and v <= size[1] - 1:
            out[n, 0], out[n, 1], out[n, 2] = u, v, inverse
            n += 1
    return n


@njit(cache=True, nogil=True)
def empty(field):
    """Takes the points out of all cells."""
    sums, filled, slots = field[0], field[1], field[2]
    for k in range(1, filled[0] + 1):
        slots[filled[k]] = 0
    sums[: _PAIR * (filled[0] + 1)] = 0
    filled[0] = 0


@njit(cache=True, nogil=True)
def add_points(points, count, place, field):
    """Adds (u, v, q) points to their cells; the middles lie at multiples of a cell's size."""
    sums, filled, slots = field[0], field[1], field[2]
    first, rows, columns, cell_px = place
    stride, per_px = columns + MARGIN, 1 / cell_px
    for k in range(count):
        u, v = points[k, 0] * per_px, points[k, 1] * per_px
        i, j = int(u + 0.5), int(v + 0.5)
        if i >= columns or j >= rows:
            continue
        cell, a, b = first + j * stride + i, np.float32(u - i), np.float32(v - j)
        pair = cell >> 1
        if slots[pair] == 0:
            filled[0] += 1
            slots[pair], filled[filled[0]] = filled[0], pair
        q = _PAIR * np.int64(slots[pair]) + SUMS * (cell & 1)
        sums[q] += _ONE
        sums[q + 1] += a
        sums[q + 2] += b
        sums[q + 3] += a * a
        sums[q + 4] += a * b
        sums[q + 5] += b * b
        sums[q + 6] += points[k, 2]
        sums[q + 7] += _ONE


@njit(cache=True, nogil=True)
def _add_around(sums, slots, cell, stride, out):
    """Fills `out` with the weighted sums of the cells around: 16 for each table, of 2 cells."""
    begin = cell - REACH * stride - REACH
    for lane in range(0, _PAIR, WIDTH):
        plain = aside = down = splat(np.float32(0))
        pair, w = begin >> 1, _TABLE * (begin & 1) + lane
        for _row in range(2 * REACH + 1):
            for k in range(REACH + 1):  # a pair without points adds the zeros of slot 0
                around = load(sums, _PAIR * np.int64(slots[pair + k]) + lane)
                plain = plus(plain, load(_PLAIN, w), around)
                aside = plus(aside, load(_ASIDE, w), around)
                down = plus(down, load(_DOWN, w), around)
                w += _PAIR
            pair += stride >> 1
        store(out, lane, plain)
        store(out, lane + _PAIR, aside)
        store(out, lane + 2 * _PAIR, down)


@njit(cache=True, nogil=True)
def _fit(sums, slots, lines, s, cell, stride, cell_px):
    """Makes the line of a cell from the points around it, weighted by a Gaussian; `s`: scratch."""
    lines[cell, 0] = 0
    _add_around(sums, slots, cell, stride, s)
    for k in range(SUMS):
        s[k] += s[k + 8]
        s[k + 16] += s[k + 24]
        s[k + 32] += s[k + 40]
    mass = np.float64(s[0])
    if mass < LEAST * cell_px:
        return
    # Of the cell, in cells: in px it is as many times larger as the cell is.
    to_px, to_square = cell_px / mass, cell_px * cell_px / mass
    a, b = (s[1] + s[16]) * to_px, (s[2] + s[32]) * to_px
    var_a = (s[3] + 2 * s[17] + s[23]) * to_square - a * a
    var_ab = (s[4] + s[18] + s[33] + s[7]) * to_square - a * b
    var_b = (s[5] + 2 * s[34] + s[39]) * to_square - b * b
    half, mean = 0.5 * (var_a - var_b), 0.5 * (var_a + var_b)
    length = np.sqrt(half * half + var_ab * var_ab)
    if length < 1e-6:
        return
    # The line runs along the major axis, at half the angle of (half, var_ab).
    along_u = np.sqrt(max(0.5 * (1 + half / length), 0.0))
    along_v = 1.0 if along_u < 1e-6 else 0.5 * var_ab / length / along_u
    lines[cell, 0] = (length / (mean + 0.05)) ** 2
    lines[cell, 1], lines[cell, 2] = -along_v, along_u
    mean_q = s[6] / mass
    lines[cell, 3], lines[cell, 4] = along_u * b - along_v * a, mean_q
    by_a, by_b = (s[22] - s[16] * mean_q) * to_px, (s[38] - s[32] * mean_q) * to_px
    lines[cell, 5] = (along_u * by_b - along_v * by_a) / np.sqrt(mean - length + _PIXEL)


@njit(cache=True, nogil=True, forceinline=True)
def line_at(place, drawing, sums, slots, made, lines, scratch, u, v):
    """The line near a place: weight, n_u, n_v, distance of the place from it, q, and its drift.

    The place less the distance times the normal n lies on the line; the weight is 0 where there is
    no line, and 1 where points lie on it exactly. A cell's line is made when it is first looked up.
    The arrays are a field's, one by one: of a tuple's, numba would count the references each time.
    """
    first, rows, columns, cell_px = place
    per_px = 1 / cell_px
    i, j = int(u * per_px + 0.5), int(v * per_px + 0.5)
    if not (u >= 0 and v >= 0 and i < columns and j < rows):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    cell = first + j * (columns + MARGIN) + i
    if made[cell] != drawing:
        made[cell] = drawing
        _fit(sums, slots, lines, scratch, cell, columns + MARGIN, float(cell_px))
    n_u, n_v = float(lines[cell, 1]), float(lines[cell, 2])
    off = n_u * (u - i * cell_px) + n_v * (v - j * cell_px) - lines[cell, 3]
    return float(lines[cell, 0]), n_u, n_v, off, float(lines[cell, 4]), float(lines[cell, 5])


@njit(cache=True, nogil=True)
def add_inverse_depth(points, count, cell_px, total, number):
    """Adds each point's inverse depth, and 1, at its cell."""
    rows, columns = total.shape
    for k in range(count):
        i, j = int(points[k, 0] / cell_px + 0.5), int(points[k, 1] / cell_px + 0.5)
        if i < columns and j < rows:
            total[j, i] += points[k, 2]
            number[j, i] += 1


@njit(cache=True, nogil=True)
def point_normals(points, T_cam_world, intrinsics, place, drawing, field, out):
    """Fills rows (n_u, n_v) of `out` with the normal of the line that each point lies on, or 0."""
    sums, _, slots, made, lines, scratch = field
    for k in range(len(points)):
        x, y, z = moved(T_cam_world, points[k, 0], points[k, 1], points[k, 2])
        out[k] = 0
        if z < NEAREST_M:
            continue
        u, v = intrinsics[0] * x / z + intrinsics[2], intrinsics[1] * y / z + intrinsics[3]
        weight, n_u, n_v, _, _, _ = line_at(place, drawing, sums, slots, made, lines, scratch, u, v)
        if weight > 0:
            out[k, 0], out[k, 1] = n_u, n_v
