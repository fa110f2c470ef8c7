"""Which surfaces come over a pixel between two frames: compiled, from both frames' samples.

What a pixel of one frame shows walks to where the other frame shows it, and every pixel on its way
learns what comes: a range of inverse depth, and whose. Pixels that learn of one range are seen
along one path (`path_kernels`); the others have layers (`layer_kernels`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.sim.compensation.edge_reach_kernels import (
    APART_PX,
    TO_FIRST,
    TO_SECOND,
    Seen,
    within_reach,
)
from eventsweep.sim.compensation.path_kernels import NO_ARRAYS, View, carried

MOST = 6
"""Layers of one pixel; where there are more, neighbours in depth are one."""
_NONE: int = np.int64(0)  # type: ignore[assignment]  # numba compiles once more for a literal


class Layers(NamedTuple):
    """The layers of pixels that need them, each pixel's from front to back.

    While they are collected, in no order, lists are (MOST, N): most pixels know of one range, so
    the first ones lie side by side.

    Attributes:
        slot: (H, W) row of each pixel in what follows; -1 where one path is enough.
        number: (N,) layers.
        way: (N, MOST) which of `ways` a layer goes.
        low: (N, MOST) least inverse depth half-way in time, 1/m.
        high: (N, MOST) greatest.
        dark: (N,) least light of all samples that come over the pixel.
        bright: (N,) greatest.
    """

    slot: NDArray[np.int32]
    number: NDArray[np.int64]
    way: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    dark: NDArray[np.float32]
    bright: NDArray[np.float32]


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def add_range(
    way: int, low: float, high: float, gap: float,
    ways: NDArray[np.int64], lows: NDArray[np.float64], highs: NDArray[np.float64], count: int,
) -> int:  # fmt: skip
    """Puts a range of inverse depth into a list of them, joined with what is near; its length.

    Args:
        way: whose.
        low: least inverse depth.
        high: greatest.
        gap: ranges of one way that are less apart are one.
        ways: in and out, (MOST,) of the list.
        lows: in and out, (MOST,).
        highs: in and out, (MOST,).
        count: its length.
    """
    k = 0
    while k < count:
        if ways[k] == way and low <= highs[k] + gap and high >= lows[k] - gap:
            if low >= lows[k] and high <= highs[k]:
                return count
            # The joined range may touch another one: take it out, and look again.
            low, high = min(low, lows[k]), max(high, highs[k])
            count -= 1
            ways[k], lows[k], highs[k] = ways[count], lows[count], highs[count]
            k = 0
        else:
            k += 1
    if count == len(ways):
        nearest, least = -1, np.inf
        for k in range(count):
            apart = max(low - highs[k], lows[k] - high)
            if ways[k] == way and apart < least:
                nearest, least = k, apart
        if nearest >= 0:
            lows[nearest], highs[nearest] = min(low, lows[nearest]), max(high, highs[nearest])
        return count
    ways[count], lows[count], highs[count] = way, low, high
    return count + 1


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def label_of(
    rho: float, i: int, j: int, body: NDArray[np.uint16], frame_rho: NDArray[np.float32], n: int
) -> int:
    """Whose a sample of a cell is: that of the neighbour whose centre is at the nearest depth.

    The centre of an even number of samples lies among four; at an edge they may not agree.
    """
    best, least, first = int(body[i, j]), np.inf, (n - 1) // 2 - n // 2
    for p in range(max(i - 1, 0), min(i + 2, body.shape[0])):
        for o in range(max(j - 1, 0), min(j + 2, body.shape[1])):
            apart = 0.0
            for k in range(first, 1):
                for m in range(first, 1):
                    apart += abs(frame_rho[n * p + n // 2 + k, n * o + n // 2 + m] - rho)
            if apart < least or (apart == least and p == i and o == j):
                best, least = int(body[p, o]), apart
    return best


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def beside_another(body: NDArray[np.uint16], i: int, j: int) -> bool:
    """Whether a pixel or one of its neighbours shows another body than the pixel's centre."""
    for p in range(max(i - 1, 0), min(i + 2, body.shape[0])):
        for o in range(max(j - 1, 0), min(j + 2, body.shape[1])):
            if body[p, o] != body[i, j]:
                return True
    return False


@numba.njit(cache=True, nogil=True)
def empty_reached(slot: NDArray[np.int32]) -> Layers:
    """Pixels, numbered from 0 on, that know nothing yet."""
    total = int(slot.max()) + 1
    return Layers(
        slot, np.zeros(total, np.int64), np.empty((MOST, total), np.int64),
        np.empty((MOST, total)), np.empty((MOST, total)),
        np.full(total, np.inf, np.float32), np.full(total, -np.inf, np.float32),
    )  # fmt: skip


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def least_gap(
    T: NDArray[np.float64], a: float, b: float, rho: float, lens: NDArray[np.float64]
) -> float:
    """How far inverse depths around `rho` differ, 1/m, whose parallax differs by `APART_PX`."""
    step = 0.05 * rho + 1e-3
    u, v = carried(T, a, b, rho, lens)
    du, dv = carried(T, a, b, rho + step, lens)
    return APART_PX * step / max(math.hypot(du - u, dv - v), 1e-9)


@numba.njit(cache=True, nogil=True, forceinline=True, **NO_ARRAYS)
def ranges_of_pixel(
    frame: Seen, i: int, j: int, n: int, gap: float, beside: bool,
    ways: NDArray[np.int64], lows: NDArray[np.float64], highs: NDArray[np.float64],
) -> int:  # fmt: skip
    """Fills in whose surfaces a pixel shows and at what inverse depths; how many ranges.

    Args:
        frame: its samples.
        i: the pixel's row, with the border.
        j: its column.
        n: samples per pixel and axis.
        gap: ranges of one way that are less apart are one, 1/m.
        beside: whether some of its samples may be another body's, at whatever depth.
        ways: out, (MOST,).
        lows: out, (MOST,), 1/m.
        highs: out, (MOST,).
    """
    least, most, own = frame.farthest[i, j], frame.nearest[i, j], int(frame.body[i, j])
    if most - least <= gap and not beside:
        return add_range(own, least, most, gap, ways, lows, highs, _NONE)  # type: ignore[no-any-return]
    count = _NONE
    for q in range(n * i, n * i + n):
        for m in range(n * j, n * j + n):
            rho = frame.rho[q, m]
            whose = label_of(rho, i, j, frame.body, frame.rho, n) if beside else own
            count = add_range(whose, rho, rho, gap, ways, lows, highs, count)
    return count


@numba.njit(cache=True, nogil=True, forceinline=True, **NO_ARRAYS)
def tell(
    k: int, way: int, low: float, high: float, gap: float, dark: float, bright: float,
    reached: Layers,
) -> None:  # fmt: skip
    """Adds a range to what the pixel in row `k` knows; arguments as in `walk`."""
    reached.dark[k] = min(reached.dark[k], dark)
    reached.bright[k] = max(reached.bright[k], bright)
    number = reached.number[k]
    if number == 1 and reached.way[0, k] == way:
        # Nearly always, and much faster than a list.
        least, most = reached.low[0, k], reached.high[0, k]
        if low <= most + gap and high >= least - gap:
            reached.low[0, k], reached.high[0, k] = min(low, least), max(high, most)
            return
    for m in range(number):
        within = low >= reached.low[m, k] and high <= reached.high[m, k]
        if within and reached.way[m, k] == way:
            return
    reached.number[k] = add_range(
        way, low, high, gap, reached.way[:, k], reached.low[:, k], reached.high[:, k], number
    )


@numba.njit(cache=True, nogil=True, forceinline=True, **NO_ARRAYS)
def walk(
    x: int, y: int, u: float, v: float, way: int, low: float, high: float, gap: float,
    dark: float, bright: float, reached: Layers,
) -> None:  # fmt: skip
    """Tells pixels from (x, y) to (u, v) of a range of inverse depth, and of its light.

    Args:
        x: column where it sets out.
        y: row.
        u: column where it ends.
        v: row.
        way: whose it is.
        low: least inverse depth half-way in time, 1/m.
        high: greatest.
        gap: ranges of one way that are less apart are one.
        dark: least light.
        bright: greatest.
        reached: in and out.
    """
    height, width = reached.slot.shape
    steps = int(max(abs(u - x), abs(v - y))) + 1
    last_left, last_top = x - 2, y - 2
    for s in range(steps + 1):
        left = math.floor(x + (u - x) * s / steps)
        top = math.floor(y + (v - y) * s / steps)
        for i in range(max(top, 0), min(top + 2, height)):
            knows_row = last_top <= i < last_top + 2
            for j in range(max(left, 0), min(left + 2, width)):
                # It goes straight: who was left behind is not met again.
                if reached.slot[i, j] >= 0 and not (knows_row and last_left <= j < last_left + 2):
                    tell(reached.slot[i, j], way, low, high, gap, dark, bright, reached)
        last_left, last_top = left, top


@numba.njit(cache=True, nogil=True, forceinline=True, **NO_ARRAYS)
def light_range(light: NDArray[np.float32], i: int, j: int, n: int) -> tuple[float, float]:
    """Least and greatest light of a pixel's samples."""
    dark, bright = np.float32(np.inf), np.float32(-np.inf)
    for q in range(n * i, n * i + n):
        for m in range(n * j, n * j + n):
            dark, bright = min(dark, light[q, m]), max(bright, light[q, m])
    return float(dark), float(bright)


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def reach_out(
    frame: Seen, n: int, border: int, view: View, to_other: int, walks: NDArray[np.uint8],
    whose: NDArray[np.int64], low: NDArray[np.float64], high: NDArray[np.float64], reached: Layers,
) -> None:  # fmt: skip
    """Tells pixels what surfaces of one frame come over them until the other frame.

    Args:
        frame: its samples.
        n: samples per pixel and axis.
        border: pixels beyond the sensor's edge.
        view: with that border.
        to_other: which of a way leads to the other frame.
        walks: (H + 2 B, W + 2 B) what may come over one of them.
        whose: memory for a list of ranges, (MOST,).
        low: likewise.
        high: likewise.
        reached: in and out.
    """
    bearing, lens, ways = view
    mixed = len(ways) > 1
    for i in range(walks.shape[0]):
        for j in range(walks.shape[1]):
            if not walks[i, j]:
                continue
            a, b = np.float64(bearing[i, j, 0]), np.float64(bearing[i, j, 1])
            own, beside = int(frame.body[i, j]), mixed and beside_another(frame.body, i, j)
            own_gap = least_gap(ways[own, to_other], a, b, np.float64(frame.nearest[i, j]), lens)
            dark, bright = light_range(frame.light, i, j, n)
            count = ranges_of_pixel(frame, i, j, n, own_gap, beside, whose, low, high)
            for k in range(count):
                rho, T = 0.5 * (low[k] + high[k]), ways[whose[k], to_other]
                u, v = carried(T, a, b, rho, lens)
                half = 0.5 + 0.5 / (T[2, 0] * a + T[2, 1] * b + T[2, 2] + T[2, 3] * rho)
                gap = own_gap if whose[k] == own else least_gap(T, a, b, rho, lens)
                walk(
                    j - border, i - border, u, v, whose[k], half * low[k], half * high[k], gap,
                    dark, bright, reached,
                )  # fmt: skip


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def sort_layers(
    way: NDArray[np.int64], low: NDArray[np.float64], high: NDArray[np.float64], count: int
) -> None:
    """Orders a list of ranges from front to back, in place."""
    for k in range(1, count):
        m = k
        while m > 0 and low[m] + high[m] > low[m - 1] + high[m - 1]:
            way[m], way[m - 1] = way[m - 1], way[m]
            low[m], low[m - 1] = low[m - 1], low[m]
            high[m], high[m - 1] = high[m - 1], high[m]
            m -= 1


@numba.njit(cache=True, nogil=True)
def chosen(reached: Layers) -> Layers:
    """The layers of the pixels over which several surfaces come."""
    slot, total = reached.slot, 0
    for k in range(len(reached.number)):
        total += reached.number[k] > 1
    layers = Layers(
        np.full(slot.shape, -1, np.int32), np.empty(total, np.int64),
        np.empty((total, MOST), np.int64), np.empty((total, MOST)), np.empty((total, MOST)),
        np.empty(total, np.float32), np.empty(total, np.float32),
    )  # fmt: skip
    k = 0
    for y in range(slot.shape[0]):
        for x in range(slot.shape[1]):
            m = slot[y, x]
            if m >= 0 and reached.number[m] > 1:
                layers.slot[y, x], layers.number[k] = k, reached.number[m]
                for i in range(MOST):  # as slices they would compile two seconds longer
                    layers.way[k, i] = reached.way[i, m]
                    layers.low[k, i] = reached.low[i, m]
                    layers.high[k, i] = reached.high[i, m]
                layers.dark[k], layers.bright[k] = reached.dark[m], reached.bright[m]
                sort_layers(layers.way[k], layers.low[k], layers.high[k], layers.number[k])
                k += 1
    return layers


@numba.njit(cache=True, nogil=True)
def find_layers(before: Seen, after: Seen, n: int, border: int, view: View) -> Layers:
    """The layers of all pixels that more than one surface comes to between two frames.

    Args:
        before: samples of the first frame.
        after: of the second.
        n: samples per pixel and axis.
        border: pixels beyond the sensor's edge.
        view: with that border.
    """
    walks = np.empty(before.body.shape, np.uint8)
    reached = empty_reached(within_reach(before, after, border, view, walks))
    ranges = np.empty(MOST, np.int64), np.empty(MOST), np.empty(MOST)
    reach_out(before, n, border, view, TO_SECOND, walks, *ranges, reached)
    reach_out(after, n, border, view, TO_FIRST, walks, *ranges, reached)
    return chosen(reached)
