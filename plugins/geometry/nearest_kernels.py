"""The compiled loops over points in the order of a space-filling curve, and over boxes of them."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

_MOST_STACKED = 128  # a node for each of 30 levels, and its sibling
_MOST_TOGETHER = 16  # queries of a group
_SLACK = 1e-3  # of a radius: normals of float32 are not of length 1


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
def leaf_boxes(start, stop, points, normals, radius_m, size, first, boxes):
    """Boxes around the discs of leaves start to stop, which hold `size` points each.

    points (N, 3) float64; normals (N, 3) and radius_m (N,) float32, or (0,) where all are points;
    boxes (nodes, 6) float32, of which those from `first` on are filled: lower and upper ends,
    rounded outwards.
    """
    for leaf in range(start, stop):
        for axis in range(3):
            low, high = np.inf, -np.inf
            for k in range(leaf * size, min((leaf + 1) * size, len(points))):
                half = 0.0
                if len(radius_m):
                    across = np.float64(normals[k, axis])
                    half = radius_m[k] * (np.sqrt(max(1 - across * across, 0.0)) + _SLACK)
                low = min(low, points[k, axis] - half)
                high = max(high, points[k, axis] + half)
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


@njit(cache=True, nogil=True, inline="always")
def _between_sq(low, high, boxes, node):
    """Squared distance of the box from `low` to `high`, (3,) each, from that of a node."""
    square = 0.0
    for axis in range(3):
        apart = max(boxes[node, axis] - high[axis], 0.0, low[axis] - boxes[node, 3 + axis])
        square += apart * apart
    return square


@njit(cache=True, nogil=True, inline="always")
def _gather(number, stop, queries, order, extent_sq, places, low, high):
    """How many queries from `number` on fit a box of that squared diagonal; one always does.

    places (group, 3) is filled with them, and low and high (3,) with the ends of their box.
    """
    low[:], high[:] = np.inf, -np.inf
    count = 0
    while count < len(places) and number + count < stop:
        q = order[number + count] if len(order) else number + count
        square = 0.0
        for axis in range(3):
            value = queries[q, axis]
            square += (max(high[axis], value) - min(low[axis], value)) ** 2
        if count and square > extent_sq:
            break
        for axis in range(3):
            value = queries[q, axis]
            places[count, axis] = value
            low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
        count += 1
    return count


@njit(cache=True, nogil=True, inline="always")
def _diagonal_sq(boxes, node):
    square = 0.0
    for axis in range(3):
        square += (boxes[node, 3 + axis] - boxes[node, axis]) ** 2
    return square


@njit(cache=True, nogil=True, inline="always")
def _in_leaf(begin, end, places, points, normals, radius_m, boxes, node, least, best):
    """Looks at discs begin to end of a node for a group of places; its largest of the `least`.

    Their squared distances `least` and discs `best` (group,) are brought up to date.
    """
    bound = 0.0
    for i in range(len(places)):
        x, y, z = places[i]
        square_i, best_i = least[i], best[i]
        if _to_box_sq(x, y, z, boxes, node) <= square_i:
            for k in range(begin, end):
                square = _to_disc_sq(x, y, z, points, normals, radius_m, k)
                if square < square_i or (square == square_i and k < best_i):
                    square_i, best_i = square, k
            least[i], best[i] = square_i, best_i
        bound = max(bound, square_i)
    return bound


@njit(cache=True, nogil=True)
def nearest(start, stop, queries, order, points, normals, radius_m, size, first, boxes, found, d_m):
    """The nearest disc of each of the queries start to stop, which are taken in an `order`.

    Neighbours in the order have near answers: a group of them, no larger than the leaf of the
    answer before, goes down the tree together and begins with that answer. Of equally near discs
    the first is taken: neither groups nor the threads' shares of the range must show.

    queries (Q, 3) float64; order (Q,) int64, or (0,) for as they are; points (N, 3) float64;
    normals (N, 3) and radius_m (N,) float32, or (0,) where all are points; boxes (nodes, 6)
    float32, the leaves of `size` points from `first` on; found (Q,) int32 and d_m (Q,) float64 are
    filled.
    """
    stack, bounds = np.empty(_MOST_STACKED, np.int64), np.empty(_MOST_STACKED)
    places, low, high = np.empty((_MOST_TOGETHER, 3)), np.empty(3), np.empty(3)
    least, best = np.empty(_MOST_TOGETHER), np.empty(_MOST_TOGETHER, np.int64)
    number = start
    last = 0
    while number < stop:
        extent_sq = _diagonal_sq(boxes, first + last // size)
        count = _gather(number, stop, queries, order, extent_sq, places, low, high)
        best[:count], least[:count] = last, np.inf
        bound = _in_leaf(
            last, last + 1, places[:count], points, normals, radius_m, boxes, 0, least, best
        )
        stack[0], bounds[0] = 0, _between_sq(low, high, boxes, 0)
        held = 1
        while held:
            held -= 1
            node = stack[held]
            if bounds[held] > bound:
                continue
            if node >= first:
                begin = (node - first) * size
                end = min(begin + size, len(points))
                bound = _in_leaf(
                    begin, end, places[:count], points, normals, radius_m, boxes, node, least, best
                )
                continue
            left, right = 2 * node + 1, 2 * node + 2
            to_left = _between_sq(low, high, boxes, left)
            to_right = _between_sq(low, high, boxes, right)
            if to_left < to_right:
                stack[held], bounds[held] = right, to_right
                stack[held + 1], bounds[held + 1] = left, to_left
            else:
                stack[held], bounds[held] = left, to_left
                stack[held + 1], bounds[held + 1] = right, to_right
            held += 2
        for i in range(count):
            q = order[number + i] if len(order) else number + i
            found[q], d_m[q] = best[i], np.sqrt(least[i])
        last = best[count - 1]
        number += count
