"""The compiled loops over points in the order of a space-filling curve, and over boxes of them."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

_MOST_STACKED = 128  # a node for each of 30 levels, and its sibling


@njit(cache=True, nogil=True)
def curve_codes(start, stop, points, origin, step, codes):
    """Morton codes of points start to stop: 21 bits of each axis, interleaved.

    points (N, 3) float64; origin (3,); step, m of a unit of the code; codes (N,) int64, filled.
    """
    for k in range(start, stop):
        code = np.int64(0)
        for axis in range(3):
            v = np.int64((points[k, axis] - origin[axis]) / step)
            v = (v | (v << 32)) & 0x1F00000000FFFF
            v = (v | (v << 16)) & 0x1F0000FF0000FF
            v = (v | (v << 8)) & 0x100F00F00F00F00F
            v = (v | (v << 4)) & 0x10C30C30C30C30C3
            v = (v | (v << 2)) & 0x1249249249249249
            code |= v << axis
        codes[k] = code


@njit(cache=True, nogil=True)
def leaf_boxes(start, stop, points, radius_m, size, first, boxes):
    """Boxes around the discs of leaves start to stop, which hold `size` points each.

    points (N, 3) float64; radius_m (N,) float32, or (0,) where all are points; boxes (nodes, 6)
    float32, of which those from `first` on are filled: lower and upper ends, rounded outwards.
    """
    for leaf in range(start, stop):
        for axis in range(3):
            low, high = np.inf, -np.inf
            for k in range(leaf * size, min((leaf + 1) * size, len(points))):
                r = radius_m[k] if len(radius_m) else 0.0
                low = min(low, points[k, axis] - r)
                high = max(high, points[k, axis] + r)
            boxes[first + leaf, axis] = np.nextafter(np.float32(low), np.float32(-np.inf))
            boxes[first + leaf, 3 + axis] = np.nextafter(np.float32(high), np.float32(np.inf))


@njit(cache=True, nogil=True)
def inner_boxes(boxes, first):
    """Boxes of the nodes before `first`, the last first: each around those of its two children."""
    for node in range(first - 1, -1, -1):
        for axis in range(3):
            boxes[node, axis] = min(boxes[2 * node + 1, axis], boxes[2 * node + 2, axis])
            boxes[node, 3 + axis] = max(
                boxes[2 * node + 1, 3 + axis], boxes[2 * node + 2, 3 + axis]
            )


@njit(cache=True, nogil=True, inline="always")
def _to_disc_sq(x, y, z, points, normals, radius_m, k):
    """Squared distance of a place from disc `k`, or from point `k` where none has a radius."""
    dx, dy, dz = x - points[k, 0], y - points[k, 1], z - points[k, 2]
    square = dx * dx + dy * dy + dz * dz
    if len(radius_m) == 0:
        return square
    along = dx * normals[k, 0] + dy * normals[k, 1] + dz * normals[k, 2]
    beside = np.sqrt(max(square - along * along, 0.0)) - radius_m[k]
    return along * along + max(beside, 0.0) ** 2


@njit(cache=True, nogil=True, inline="always")
def _to_box_sq(x, y, z, boxes, node):
    dx = max(boxes[node, 0] - x, 0.0, x - boxes[node, 3])
    dy = max(boxes[node, 1] - y, 0.0, y - boxes[node, 4])
    dz = max(boxes[node, 2] - z, 0.0, z - boxes[node, 5])
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def nearest(start, stop, queries, order, points, normals, radius_m, size, first, boxes, found, d_m):
    """The nearest disc of each of the queries start to stop, which are taken in an `order`.

    Neighbours in the order have near answers, so each search begins with the answer before. Of
    equally near ones the first is taken: the threads' shares of the range must not show.

    queries (Q, 3) float64; order (Q,) int64; points (N, 3) float64; normals (N, 3) and radius_m
    (N,) float32, or (0,) where all are points; boxes (nodes, 6) float32, the leaves of `size`
    points from `first` on; found (Q,) int64 and d_m (Q,) float64 are filled.
    """
    stack = np.empty(_MOST_STACKED, np.int64)
    bounds = np.empty(_MOST_STACKED)
    best = 0
    for number in range(start, stop):
        q = order[number]
        x, y, z = queries[q, 0], queries[q, 1], queries[q, 2]
        least = _to_disc_sq(x, y, z, points, normals, radius_m, best)
        stack[0], bounds[0] = 0, _to_box_sq(x, y, z, boxes, 0)
        held = 1
        while held:
            held -= 1
            node = stack[held]
            if bounds[held] > least:
                continue
            if node >= first:
                leaf = node - first
                for k in range(leaf * size, min((leaf + 1) * size, len(points))):
                    square = _to_disc_sq(x, y, z, points, normals, radius_m, k)
                    if square < least or (square == least and k < best):
                        least, best = square, k
                continue
            left, right = 2 * node + 1, 2 * node + 2
            to_left = _to_box_sq(x, y, z, boxes, left)
            to_right = _to_box_sq(x, y, z, boxes, right)
            if to_left < to_right:
                stack[held], bounds[held] = right, to_right
                stack[held + 1], bounds[held + 1] = left, to_left
            else:
                stack[held], bounds[held] = left, to_left
                stack[held + 1], bounds[held + 1] = right, to_right
            held += 2
        found[q], d_m[q] = best, np.sqrt(least)
