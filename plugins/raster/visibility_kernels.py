"""Compiled loops that find which triangle each sample of a pinhole picture sees.

A triangle's edges are planes through the eye. Each is a function of a sample's column and row, 0 on
the edge and positive inside, scaled so that their sum is 1/z. So columns where a row of samples
enters and leaves come from divisions, whatever lies behind the camera, and no picture need be cut.
A sample of row y lies `shift(y)` columns to the right: rows may lie beside one another.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

# Triangles reach a little beyond their edges: rounding leaves no sample between two of them.
_OVERLAP = 1e-7
_FLAT = -1e-18


@njit(cache=True, nogil=True, error_model="numpy")
def shift(row, stride):
    """How far the samples of a row lie to the right of their columns."""
    return (row % stride + 0.5) / stride - 0.5


@njit(cache=True, nogil=True, error_model="numpy")
def _edges_of(c, intrinsics, turned, e):
    """Fills `e` (3, 3), each edge's factors of column and row and its value at 0.

    Returns False where the triangle is seen from behind, or `turned` from ahead. `c` (3, 3) are
    the corners in the camera's axes.
    """
    f_x, f_y, c_x, c_y = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    volume = 0.0
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        e[i, 0] = c[a, 1] * c[b, 2] - c[a, 2] * c[b, 1]
        e[i, 1] = c[a, 2] * c[b, 0] - c[a, 0] * c[b, 2]
        e[i, 2] = c[a, 0] * c[b, 1] - c[a, 1] * c[b, 0]
    volume = c[0, 0] * e[0, 0] + c[0, 1] * e[0, 1] + c[0, 2] * e[0, 2]
    if (-volume if turned else volume) >= _FLAT:
        return False
    for i in range(3):
        e[i, 0] = e[i, 0] / volume / f_x
        e[i, 1] = e[i, 1] / volume / f_y
        e[i, 2] = e[i, 2] / volume - e[i, 0] * c_x - e[i, 1] * c_y
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _bounds(c, intrinsics, view, box):
    """Fills `box` with first and last column and row that a triangle ahead may touch."""
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for k in range(3):
        u = c[k, 0] / c[k, 2] * intrinsics[0] + intrinsics[2]
        v = c[k, 1] / c[k, 2] * intrinsics[1] + intrinsics[3]
        left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
    box[0] = max(float(view[0]), math.floor(left) - 1.0)
    box[1] = min(float(view[1]), math.ceil(right) + 1.0)
    box[2] = max(float(view[2]), math.ceil(top - _OVERLAP))
    box[3] = min(float(view[3]), math.floor(bottom + _OVERLAP))


@njit(cache=True, nogil=True, error_model="numpy")
def _cut_by(plane, q, intrinsics, cut):
    """Fills `cut` (3,) of the part of a triangle, of 1/z `q` (3,), on one side of a plane (4,)."""
    for k in range(3):
        cut[k] = plane[3] * q[k]
    cut[0] += plane[0] / intrinsics[0]
    cut[1] += plane[1] / intrinsics[1]
    cut[2] += plane[2] - plane[0] * intrinsics[2] / intrinsics[0]
    cut[2] -= plane[1] * intrinsics[3] / intrinsics[1]


@njit(cache=True, nogil=True, error_model="numpy")
def _crossings(planes, count, crossing):
    """Fills `crossing` (N, 3) with where a row crosses planes: column = [0] row + [1].

    [2] says which side is inside: 1 to the right, -1 to the left, 0 where a row is parallel, and
    [0] row + [1] is positive inside.
    """
    for i in range(count):
        slope = planes[i, 0]
        side = 1.0 if slope > 0.0 else -1.0
        if slope == 0.0:
            crossing[i, 0], crossing[i, 1], crossing[i, 2] = planes[i, 1], planes[i, 2], 0.0
        else:
            crossing[i, 0], crossing[i, 1] = -planes[i, 1] / slope, -planes[i, 2] / slope
            crossing[i, 1] -= side * _OVERLAP
            crossing[i, 2] = side


@njit(cache=True, nogil=True, error_model="numpy")
def _span(crossing, count, y, x0, low, high):
    """First and last column, within two, where a row is inside; the first is larger if nowhere."""
    for i in range(count):
        at = crossing[i, 0] * y + crossing[i, 1]
        if crossing[i, 2] > 0.0:
            low = max(low, at - x0)
        elif crossing[i, 2] < 0.0:
            high = min(high, at - x0)
        elif at < 0.0:
            high = low - 1.0
    # Planes that are almost parallel to a row cross it farther away than whole numbers reach.
    return (math.ceil(low), math.floor(high)) if low <= high else (1, 0)


@njit(cache=True, nogil=True, error_model="numpy")
def _nearer(start, step, number, first, count, nearness, ids):
    """Puts a triangle where nothing nearer is; at the same depth the later one shows."""
    for x in range(count):
        # Without a sign there is no negative index to look for, and the loop vectorises.
        k = np.uint64(first + x)
        value = start + step * np.float32(np.int32(x))
        shows = value >= nearness[k]
        nearness[k] = value if shows else nearness[k]
        ids[k] = number if shows else ids[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _next(start, step, number, first, count, after, nearness, ids):
    """Puts a triangle where none is yet, and its number is larger than `after`."""
    for x in range(count):
        k = first + x
        if ids[k] < 0 and number > after[k]:
            nearness[k], ids[k] = start + step * np.float32(np.int32(x)), number


@njit(cache=True, nogil=True, error_model="numpy")
def visible(  # noqa: C901
    corners, first, order, turned, T_cam_world, intrinsics, stride, view, clip, beyond, scale,
    after, nearness, ids, edges, source, made,
):  # fmt: skip
    """Draws triangles and returns how many may be seen.

    Args:
        corners: (T, 3, 3) in the world's axes, m.
        first: (G + 1,) the first triangle of each geom.
        order: (N,) geoms to draw, one after the other.
        turned: (G,) of which geoms the backs are drawn instead.
        T_cam_world: (4, 4).
        intrinsics: (4,) fx, fy, cx, cy, in samples of the picture.
        stride: rows that lie beside one another.
        view: (4,) first and last column, first and last row to draw.
        clip: (2,) nearest and farthest depth, m.
        beyond: (4,) a plane in the camera's axes: only what lies where n x + d is positive is
            drawn; 0 for everything.
        scale: (2,) `nearness` is scale[0] / z - scale[1].
        after: (H, W) int32 to draw, whatever is nearer, the first triangle of a larger number; or
            (0, 0).
        nearness: in and out, (H, W) float32; 0 is nothing.
        ids: in and out, (H, W) int32, number of a triangle among those seen; -1 is nothing.
        edges: out, (T, 3, 3) of those seen.
        source: out, (T,) which these are.
        made: how many there are of other pictures, whose numbers come first.
    """
    c, e, box = np.empty((3, 3)), np.empty((6, 3)), np.empty(4)
    q, crossing = np.empty(3), np.empty((6, 3))
    columns, near, known = nearness.shape[1], nearness.reshape(-1), ids.reshape(-1)
    past, in_turn = after.reshape(-1), after.size > 0
    for g in order:
        for t in range(first[g], first[g + 1]):
            least, most = np.inf, -np.inf
            for k in range(3):
                for i in range(3):
                    c[k, i] = (
                        T_cam_world[i, 0] * corners[t, k, 0] + T_cam_world[i, 1] * corners[t, k, 1]
                        + T_cam_world[i, 2] * corners[t, k, 2] + T_cam_world[i, 3]
                    )  # fmt: skip
                least, most = min(least, c[k, 2]), max(most, c[k, 2])
            if most < clip[0] or least > clip[1] or not _edges_of(c, intrinsics, turned[g], e):
                continue
            for k in range(4):
                box[k] = view[k]
            if least > clip[0]:
                _bounds(c, intrinsics, view, box)
            for k in range(3):
                q[k] = e[0, k] + e[1, k] + e[2, k]
            count = 3
            if least <= clip[0] or most >= clip[1]:
                for k in range(3):
                    e[3, k], e[4, k] = q[k], -q[k]
                e[3, 2] -= 1.0 / clip[1]
                e[4, 2] += 1.0 / clip[0]
                count = 5
            if beyond[3] != 0.0:
                _cut_by(beyond, q, intrinsics, e[count])
                count += 1
            _crossings(e, count, crossing)
            seen = False
            for y in range(int(box[2]), int(box[3]) + 1):
                x0 = shift(y, stride)
                a, b = _span(crossing, count, y, x0, box[0], box[1])
                if a > b:
                    continue
                seen = True
                left = int(a)
                rho = q[1] * y + q[2] + q[0] * (x0 + a)
                start, step = np.float32(scale[0] * rho - scale[1]), np.float32(scale[0] * q[0])
                number, at, wide = np.int32(made), y * columns + left, int(b) - left + 1
                if in_turn:
                    _next(start, step, number, at, wide, past, near, known)
                else:
                    _nearer(start, step, number, at, wide, near, known)
            if seen:
                source[made] = t
                for i in range(3):
                    for k in range(3):
                        edges[made, i, k] = e[i, k]
                made += 1
    return made
