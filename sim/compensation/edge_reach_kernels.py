"""Where surfaces can come apart between two frames: compiled; most pixels are far from that.

Two surfaces come over one pixel only where the edge of one passes it: what lies at a depth edge, or
beside another body, walks to its place in the other frame, and only pixels on its way can need
layers (`layer_search_kernels`). Only what comes over one of these must be walked as well.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.sim.compensation.path_kernels import (
    NO_ARRAYS,
    TO_FIRST_END,
    TO_SECOND_START,
    View,
    carried,
)

APART_PX = 0.25
"""Surfaces whose parallax over the interval differs by less are one layer."""
# What is no further from an edge belongs to it; and pixels beside an edge's way are on it.
_EDGE_WIDTH_PX, _BESIDE_PX = 1, 1
_FAR_PX = 1 << 14
# As they are, numba would compile once for each.
TO_FIRST: int = np.int64(TO_FIRST_END)  # type: ignore[assignment]
TO_SECOND: int = np.int64(TO_SECOND_START)  # type: ignore[assignment]


class Seen(NamedTuple):
    """One frame, as its samples show it.

    Attributes:
        light: (S (H + 2 B), S (W + 2 B)) light of each sample.
        rho: the same shape, inverse depth, 1/m; 0 where there is no surface.
        boxes: `FineFrame.light`, the mean light of S x S samples from each sample on.
        nearest: (H + 2 B, W + 2 B) greatest inverse depth of each pixel's samples.
        farthest: (H + 2 B, W + 2 B) least.
        body: (H + 2 B, W + 2 B) which way each pixel's surface goes.
    """

    light: NDArray[np.float32]
    rho: NDArray[np.float32]
    boxes: NDArray[np.float32]
    nearest: NDArray[np.float32]
    farthest: NDArray[np.float32]
    body: NDArray[np.uint16]


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def is_quiet(
    spread: float, a: float, b: float, T: NDArray[np.float64], lens: NDArray[np.float64]
) -> bool:
    """Whether surfaces whose inverse depths differ by so much cannot come apart by `APART_PX`.

    Args:
        spread: of inverse depth, 1/m.
        a: x/z of where they are seen.
        b: y/z.
        T: (4, 4) camera coordinates in one frame to those in the other.
        lens: see `path_kernels.distorted`.
    """
    along = abs(T[0, 3]) + abs(T[2, 3]) * (abs(a) + 0.1)
    across = abs(T[1, 3]) + abs(T[2, 3]) * (abs(b) + 0.1)
    quiet: bool = spread * max(lens[0], lens[1]) * math.hypot(along, across) < APART_PX
    return quiet


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def mark_edges(frame: Seen, view: View, to_other: int, marked: NDArray[np.uint8]) -> None:
    """Marks each pixel that, with its neighbours right and below, shows several surfaces.

    Args:
        frame: its samples.
        view: with the frame's border.
        to_other: which of a way leads to the other frame.
        marked: in and out, (H + 2 B, W + 2 B).
    """
    bearing, lens, ways = view
    rows, columns = marked.shape
    nearest, farthest, body = frame.nearest, frame.farthest, frame.body
    for i in range(rows):
        p = min(i + 1, rows - 1)
        for j in range(columns):
            q = min(j + 1, columns - 1)
            near = max(max(nearest[i, j], nearest[i, q]), max(nearest[p, j], nearest[p, q]))
            far = min(min(farthest[i, j], farthest[i, q]), min(farthest[p, j], farthest[p, q]))
            own = body[i, j]
            if own != body[i, q] or own != body[p, j] or own != body[p, q]:
                marked[i, j] = 1
            elif near > far:
                a, b = np.float64(bearing[i, j, 0]), np.float64(bearing[i, j, 1])
                spread = np.float64(near) - np.float64(far)
                marked[i, j] |= not is_quiet(spread, a, b, ways[own, to_other], lens)


@numba.njit(cache=True, nogil=True)
def distances(marked: NDArray[np.uint8]) -> NDArray[np.int16]:
    """How many rows or columns, whichever are more, each pixel is from the nearest marked one."""
    rows, columns = marked.shape
    # Two rows and columns more, so that every pixel has neighbours.
    wide = np.full((rows + 2, columns + 2), _FAR_PX, np.int16)
    for i in range(1, rows + 1):
        for j in range(1, columns + 1):
            if marked[i - 1, j - 1]:
                wide[i, j] = 0
            else:
                above = min(wide[i - 1, j - 1], wide[i - 1, j], wide[i - 1, j + 1])
                wide[i, j] = min(above, wide[i, j - 1]) + 1
    for i in range(rows, 0, -1):
        for j in range(columns, 0, -1):
            below = min(wide[i + 1, j - 1], wide[i + 1, j], wide[i + 1, j + 1])
            wide[i, j] = min(wide[i, j], min(below, wide[i, j + 1]) + 1)
    return wide[1:-1, 1:-1]


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def mark_way(x: int, y: int, u: float, v: float, marked: NDArray[np.uint8]) -> None:
    """Marks all pixels on the straight way from (x, y) to (u, v)."""
    rows, columns = marked.shape
    steps = int(max(abs(u - x), abs(v - y))) + 1
    for s in range(steps + 1):
        left = math.floor(x + (u - x) * s / steps)
        top = math.floor(y + (v - y) * s / steps)
        for i in range(max(top, 0), min(top + 2, rows)):
            for j in range(max(left, 0), min(left + 2, columns)):
                marked[i, j] = 1


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def mark_ways(
    frame: Seen,
    border: int,
    view: View,
    to_other: int,
    away: NDArray[np.int16],
    marked: NDArray[np.uint8],
) -> None:
    """Marks the ways of what lies at edges.

    Args:
        frame: its samples.
        border: pixels beyond the sensor's edge.
        view: with that border.
        to_other: which of a way leads to the other frame.
        away: (H + 2 B, W + 2 B) how far the nearest edge is, px.
        marked: in and out, (H + 2 B, W + 2 B).
    """
    bearing, lens, ways = view
    rows, columns = away.shape
    for i in range(rows):
        for j in range(columns):
            if away[i, j] > _EDGE_WIDTH_PX:
                continue
            a, b, last = np.float64(bearing[i, j, 0]), np.float64(bearing[i, j, 1]), -1
            for p in range(max(i - 1, 0), min(i + 2, rows)):
                for q in range(max(j - 1, 0), min(j + 2, columns)):
                    own = int(frame.body[p, q])
                    if own == last:
                        continue
                    last = own
                    for rho in (frame.nearest[i, j], frame.farthest[i, j]):
                        u, v = carried(ways[own, to_other], a, b, np.float64(rho), lens)
                        mark_way(j, i, u + border, v + border, marked)


@numba.njit(cache=True, nogil=True)
def within_reach(
    before: Seen, after: Seen, border: int, view: View, walks: NDArray[np.uint8]
) -> NDArray[np.int32]:
    """Numbers the pixels over which several surfaces can come, and marks what comes over these.

    Args:
        before: samples of the first frame.
        after: of the second.
        border: pixels beyond the sensor's edge.
        view: with that border.
        walks: out, (H + 2 B, W + 2 B) whether what a pixel shows may come over a numbered one.

    Returns:
        (H, W) from 0 on in raster order; -1 where one surface comes.
    """
    rows, columns = walks.shape
    walks[:] = 0
    mark_edges(before, view, TO_SECOND, walks)
    mark_edges(after, view, TO_FIRST, walks)
    away = distances(walks)
    mark_ways(before, border, view, TO_SECOND, away, walks)
    mark_ways(after, border, view, TO_FIRST, away, walks)
    away = distances(walks)
    numbers, count = np.full((rows - 2 * border, columns - 2 * border), -1, np.int32), 0
    for i in range(rows):
        for j in range(columns):
            # Edges of both frames walk, of what is near and of what is far: what comes over a pixel
            # with layers from further away has been on one of these ways before.
            walks[i, j] = away[i, j] <= _BESIDE_PX + 1
            inside = border <= i < rows - border and border <= j < columns - border
            if inside and away[i, j] <= _BESIDE_PX:
                numbers[i - border, j - border] = count
                count += 1
    return numbers
