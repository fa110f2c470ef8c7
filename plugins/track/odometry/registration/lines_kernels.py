"""Compiled loops of line fields: points in cells of the image, and the lines that they lie on.

Motions are (4, 4) float64 matrices; `intrinsics` is (4,) float64 fx, fy, cx, cy of a pinhole, px.

A field is a tuple of flat arrays over the cells of all images:

    sums: (8 N + 16,) float32, from number 16 k on those of the k-th pair of cells that holds
        points, 8 of each cell's: 1, a, b, aa, ab, bb, q, 1; a, b from its middle, in cells.
    filled: (N / 2 + 1,) int32, how many pairs hold points, then which.
    slots: (N / 2,) int32, k of each pair, 0 of one that holds none.
    made: (N,) int32, the row of each cell's line, at least 1, if `cells` says so, too.
    lines: (N + 1, 6) float32, from row 1 on the lines made so far: weight, n_u, n_v, distance of
        the line from the cell's middle, px, mean of q, and its covariance with the distance across
        the line over that one's deviation.
    cells: (N + 1,) int32, how many lines are made, then the cell of each.
    scratch: (64,) float32.

What a point carries besides its place, q, is its inverse depth in a map. Of an event it is its time
over the standard deviation of all, or 0: then the last number is the correlation of time with the
distance across the line. The expected motion of the rig is taken out of events before, so edges at
rest stay where they are, at any depth, and it is about 0; of a body that moves by itself they
drift.

Sums lie side by side in the order in which cells were filled: edges fill one cell in twenty, and
theirs stay in a core's cache, as those of all cells would not. A pair is one line of it. So do
lines, in the order in which they were made. A row that is not yet made, or of another cell, says
that there is no line of this cell: to empty the field is to forget how many there are.

`place` is (4,) int64 of one image: its first cell, rows, columns, an even number, and the size of a
cell, px. Each row is followed by `MARGIN` cells more, and there are `REACH` empty rows above and
below: cells out of the image are read like all others.
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
_ONE, _HALF = np.float32(1), np.float32(0.5)


def _weights():
    """What multiplies the sums of the cells around, by rows, then by pairs of columns; flat.

    Moments about the middle of the cell in question follow from those about each cell's own: with
    weights w, and the cell (a, b) cells away, needed are the sums of w, w a, w b and w a b, and of
    the last number, which is as the first, w a² and w b² instead of w a and w b. q counts as if it
    lay in its cell's middle. A weight is the row's times the column's: of rows w and w b, of
    columns w and w a. Columns stand there twice: pairs begin 3 cells before the one in question,
    or 4.
    """
    rows, columns = np.ones((2 * REACH + 1, 2, 2, SUMS)), np.ones((2, REACH + 1, 2, 2, SUMS))
    b = np.arange(-REACH, REACH + 1.0)
    a = np.arange(2.0 * MARGIN).reshape(REACH + 1, 2) - np.array([[[REACH]], [[REACH + 1]]])
    for table, away in ((rows, b[:, None]), (columns, a)):
        w = np.exp(-0.5 * (away / _SIGMA_CELLS) ** 2) * (abs(away) <= REACH)
        table[..., 1, :, :] = away[..., None]
        table[..., 1, :, -1] **= 2
        table *= w[..., None, :, None] / np.exp(-0.5 * (b / _SIGMA_CELLS) ** 2).sum()
    return rows.astype(np.float32).reshape(-1), columns.astype(np.float32).reshape(-1)


_ROWS, _COLUMNS = _weights()


@njit(cache=True, nogil=True, forceinline=True)
def moved(T, x, y, z):
    """A point, carried by a rigid motion."""
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
    )


@njit(cache=True, nogil=True, forceinline=True)
def seen_at(x, y, z, intrinsics, size):
    """Where a camera sees a point, px, and its inverse depth: 0 if that is out of the image."""
    if z < NEAREST_M:
        return 0.0, 0.0, 0.0
    inverse = 1 / z
    u = intrinsics[0] * x * inverse + intrinsics[2]
    v = intrinsics[1] * y * inverse + intrinsics[3]
    if u >= 0 and v >= 0 and u <= size[0] - 1 and v <= size[1] - 1:
        return u, v, inverse
    return 0.0, 0.0, 0.0


@njit(cache=True, nogil=True)
def project(points, T_cam_world, intrinsics, size, out):
    """Fills rows (u, v, inverse depth) of `out` with the points in view; returns how many."""
    n = 0
    for k in range(len(points)):
        x, y, z = moved(T_cam_world, points[k, 0], points[k, 1], points[k, 2])
        u, v, inverse = seen_at(x, y, z, intrinsics, size)
        if inverse > 0:
            out[n, 0], out[n, 1], out[n, 2] = u, v, inverse
            n += 1
    return n


@njit(cache=True, nogil=True)
def empty(field):
    """Takes the points out of all cells."""
    sums, filled, slots, cells = field[0], field[1], field[2], field[5]
    cells[0] = 0
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
    """Fills `out` with the sums of the cells around by w, w a, w b and w a b: 16 each, of 2 cells.

    Column by column first: eight sums at once do not wait for each other.
    """
    begin = cell - REACH * stride - REACH
    for lane in range(0, _PAIR, WIDTH):
        w0 = w1 = w2 = w3 = b0 = b1 = b2 = b3 = splat(np.float32(0))
        pair = begin >> 1
        for row in range(2 * REACH + 1):
            at = 2 * _PAIR * row + lane
            w, b = load(_ROWS, at), load(_ROWS, at + _PAIR)
            # A pair without points adds the zeros of slot 0.
            around = load(sums, _PAIR * np.int64(slots[pair]) + lane)
            w0, b0 = plus(w0, w, around), plus(b0, b, around)
            around = load(sums, _PAIR * np.int64(slots[pair + 1]) + lane)
            w1, b1 = plus(w1, w, around), plus(b1, b, around)
            around = load(sums, _PAIR * np.int64(slots[pair + 2]) + lane)
            w2, b2 = plus(w2, w, around), plus(b2, b, around)
            around = load(sums, _PAIR * np.int64(slots[pair + 3]) + lane)
            w3, b3 = plus(w3, w, around), plus(b3, b, around)
            pair += stride >> 1
        for k in range(lane, lane + 2 * _PAIR, _PAIR):
            at = 8 * _PAIR * (begin & 1) + k
            c0, c1 = load(_COLUMNS, at), load(_COLUMNS, at + 2 * _PAIR)
            c2, c3 = load(_COLUMNS, at + 4 * _PAIR), load(_COLUMNS, at + 6 * _PAIR)
            store(out, k, plus(plus(plus(c0 * w0, c1, w1), c2, w2), c3, w3))
            store(out, k + 2 * _PAIR, plus(plus(plus(c0 * b0, c1, b1), c2, b2), c3, b3))


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(sums, slots, line, s, cell, stride, size_px):
    """Makes the line of a cell from the points around it, weighted by a Gaussian; `s`: scratch."""
    line[0] = 0
    _add_around(sums, slots, cell, stride, s)
    for k in range(SUMS):
        s[k] += s[k + 8]
        s[k + 16] += s[k + 24]
        s[k + 32] += s[k + 40]
    s[48] += s[56]
    mass, cell_px = s[0], np.float32(size_px)
    if mass < np.float32(LEAST) * cell_px:
        return
    # Of the cell, in cells: in px it is as many times larger as the cell is.
    per_mass = _ONE / mass
    to_px = cell_px * per_mass
    to_square = cell_px * to_px
    a, b = (s[1] + s[16]) * to_px, (s[2] + s[32]) * to_px
    var_a = (s[3] + s[17] + s[17] + s[23]) * to_square - a * a
    var_ab = (s[4] + s[18] + s[33] + s[48]) * to_square - a * b
    var_b = (s[5] + s[34] + s[34] + s[39]) * to_square - b * b
    half, mean = _HALF * (var_a - var_b), _HALF * (var_a + var_b)
    length = np.sqrt(half * half + var_ab * var_ab)
    if length < np.float32(1e-6):
        return
    # The line runs along the major axis, at half the angle of (half, var_ab).
    per_length = _HALF / length
    long = np.sqrt(_HALF + abs(half) * per_length)
    short = var_ab * per_length / long
    along_u = long if half > 0 else short
    along_v = short if half > 0 else long
    straight = length / (mean + np.float32(0.05))
    line[0] = straight * straight
    line[1], line[2] = -along_v, along_u
    mean_q = s[6] * per_mass
    line[3], line[4] = along_u * b - along_v * a, mean_q
    by_a, by_b = (s[22] - s[16] * mean_q) * to_px, (s[38] - s[32] * mean_q) * to_px
    across = max(mean - length, np.float32(0)) + np.float32(_PIXEL)
    line[5] = (along_u * by_b - along_v * by_a) / np.sqrt(across)


@njit(cache=True, nogil=True, forceinline=True)
def line_at(place, sums, slots, made, lines, cells, scratch, u, v):
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
    k = np.int64(made[cell])
    if k > cells[0] or cells[k] != cell:
        cells[0] += 1
        k = np.int64(cells[0])
        made[cell], cells[k] = k, cell
        _fit(sums, slots, lines[k], scratch, cell, columns + MARGIN, float(cell_px))
    n_u, n_v = float(lines[k, 1]), float(lines[k, 2])
    off = n_u * (u - i * cell_px) + n_v * (v - j * cell_px) - lines[k, 3]
    return float(lines[k, 0]), n_u, n_v, off, float(lines[k, 4]), float(lines[k, 5])


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
def point_normals(points, T_cam_world, intrinsics, place, field, out):
    """Fills rows (n_u, n_v) of `out` with the normal of the line that each point lies on, or 0."""
    sums, _, slots, made, lines, cells, scratch = field
    for k in range(len(points)):
        x, y, z = moved(T_cam_world, points[k, 0], points[k, 1], points[k, 2])
        out[k] = 0
        if z < NEAREST_M:
            continue
        u, v = intrinsics[0] * x / z + intrinsics[2], intrinsics[1] * y / z + intrinsics[3]
        weight, n_u, n_v, _, _, _ = line_at(place, sums, slots, made, lines, cells, scratch, u, v)
        if weight > 0:
            out[k, 0], out[k, 1] = n_u, n_v
