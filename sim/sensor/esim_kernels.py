"""The event model's compiled loops: find the pixels that fire, then fill their events.

Two passes, because few pixels change by a threshold between frames: the first streams over all
pixels and says how many events to make room for, the second visits the few that fire. What only
those need lies together in one record per pixel, as every visit costs a cache miss. The loops hold
no lock and start no threads of their own: cameras run side by side, the renderer keeps the rest.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

PIXEL = np.dtype(
    [
        ("last_emitted_us", np.int64),
        ("first_log", np.float32),
        ("up", np.int32),
        ("down", np.int32),
    ],
    align=True,
)
"""A pixel's memory: last emitted event, first log intensity, rises and falls since."""


TIE = 1e-6
"""A level counts as reached from this close, ln intensity: means of float32 samples are rounded by
nearly as much, and light that comes back to a grey, an uncovered wall, comes back to the level."""
NEAR = 2 * TIE
"""Nobody further from a level than this can reach it, however sums are rounded."""


@numba.njit(cache=True, nogil=True, inline="always")
def level_of(first: float, up: int, down: int, c_pos: float, c_neg: float) -> float:
    """Reference after `up` rises and `down` falls from the first value.

    The net change is summed first: where rises and falls cancel, the level is the first value
    itself, and not one that rounding puts beside it.
    """
    return first + (up * c_pos - down * c_neg)


@numba.njit(cache=True, nogil=True, fastmath=False)
def number_of_rises(
    log: float, first: float, up: int, down: int, c_pos: float, c_neg: float
) -> int:
    """Levels above the reference that `log` reaches."""
    count = 0
    while log >= level_of(first, up + count + 1, down, c_pos, c_neg) - TIE:
        count += 1
    return count


@numba.njit(cache=True, nogil=True, fastmath=False)
def number_of_falls(
    log: float, first: float, up: int, down: int, c_pos: float, c_neg: float
) -> int:
    """Levels below the reference that `log` reaches."""
    count = 0
    while log <= level_of(first, up, down + count + 1, c_pos, c_neg) + TIE:
        count += 1
    return count


@numba.njit(cache=True, nogil=True, inline="always")
def crossing_offset_us(level: float, before: float, slope: float, step_us: int) -> int:
    """Time of a crossing after the frame before, 1 to `step_us`, halves to the even microsecond.

    The product comes before the division, so that an exact half stays one.
    """
    return min(max(int(np.rint((level - before) * step_us / slope)), 1), step_us)


@numba.njit(cache=True, nogil=True)
def find(
    log_now: NDArray[np.float32],
    reference: NDArray[np.float64],
    memory: NDArray[np.void],
    c_pos: float,
    c_neg: float,
    fired: NDArray[np.int32],
    crossings: NDArray[np.int32],
) -> int:
    """Finds the pixels whose log intensity reaches the next level above or below.

    Args:
        log_now: (P,) log intensity, pixels in raster order.
        reference: (P,) `first_log` moved by all crossings so far.
        memory: (P,) records of `PIXEL`.
        c_pos: threshold C+.
        c_neg: threshold C-.
        fired: out, (P,) of which the first n are filled: indices of those pixels.
        crossings: out, likewise: how many thresholds each passed, negative for falls.

    Returns:
        n.
    """
    # Who may fire is written down without a branch, which would be foreseen wrongly.
    near, rise, fall = 0, c_pos - NEAR, NEAR - c_neg
    for k in range(len(log_now)):
        change = log_now[k] - reference[k]
        fired[near] = k
        near += int(change >= rise) | int(change <= fall)
    n = 0
    for m in range(near):
        k = fired[m]
        change = log_now[k] - reference[k]
        log, first = np.float64(log_now[k]), np.float64(memory[k].first_log)
        up, down = memory[k].up, memory[k].down
        if change > 0:
            count = number_of_rises(log, first, up, down, c_pos, c_neg)
        else:
            count = -number_of_falls(log, first, up, down, c_pos, c_neg)
        if count != 0:
            fired[n], crossings[n] = k, count
            n += 1
    return n


@numba.njit(cache=True, nogil=True)
def emit(
    log_before: NDArray[np.float32],
    log_now: NDArray[np.float32],
    reference: NDArray[np.float64],
    memory: NDArray[np.void],
    fired: NDArray[np.int32],
    crossings: NDArray[np.int32],
    width_px: int,
    before_us: int,
    step_us: int,
    c_pos: float,
    c_neg: float,
    refractory_us: int,
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    offset_us: NDArray[np.int64],
    p: NDArray[np.uint8],
) -> None:
    """Fills one event per crossing and moves the pixels' memory on.

    Args:
        log_before: (P,) log intensity at `before_us`.
        log_now: (P,) log intensity `step_us` later.
        reference: in and out, (P,).
        memory: in and out, (P,) records of `PIXEL`.
        fired: (n,) pixels, from `find`.
        crossings: (n,) their crossings, from `find`.
        width_px: pixels in a row.
        before_us: time of the frame before, µs.
        step_us: time from frame to frame, µs.
        c_pos: threshold C+.
        c_neg: threshold C-.
        refractory_us: least time between two emitted events of a pixel, µs.
        x: out, (N,) columns.
        y: out, (N,) rows.
        offset_us: out, (N,) time after `before_us`, 1 to `step_us`; 0 where suppressed.
        p: out, (N,) 1 for a rise, 0 for a fall.
    """
    event = 0
    for n in range(len(fired)):
        k = fired[n]
        rise = crossings[n] > 0
        first, up, down = np.float64(memory[k].first_log), memory[k].up, memory[k].down
        last_us = memory[k].last_emitted_us
        before = np.float64(log_before[k])
        slope = np.float64(log_now[k]) - before
        row = k // width_px
        column = k - row * width_px
        for _ in range(abs(crossings[n])):
            if rise:
                up += 1
            else:
                down += 1
            level = level_of(first, up, down, c_pos, c_neg)
            offset = crossing_offset_us(level, before, slope, step_us)
            silent = before_us + offset - last_us < refractory_us
            if not silent:
                last_us = before_us + offset
            x[event], y[event], p[event] = column, row, rise
            offset_us[event] = 0 if silent else offset
            event += 1
        memory[k].up, memory[k].down = up, down
        memory[k].last_emitted_us = last_us
        reference[k] = level_of(first, up, down, c_pos, c_neg)


@numba.njit(cache=True, nogil=True)
def counting_order(
    key: NDArray[np.int64], ends: NDArray[np.int64], order: NDArray[np.int64]
) -> None:
    """Fills `order` (N,) with the stable order of `key` (N,).

    Args:
        key: (N,) values in [0, K).
        ends: in zeros, out (K,) where each value's stretch of `order` ends.
        order: out, (N,).
    """
    for i in range(len(key)):
        ends[key[i]] += 1
    total = 0
    for value in range(len(ends)):
        number = ends[value]
        ends[value] = total
        total += number
    for i in range(len(key)):
        order[ends[key[i]]] = i
        ends[key[i]] += 1
