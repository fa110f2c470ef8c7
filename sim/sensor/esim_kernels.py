"""The event model's compiled loops: find the pixels that fire, then fill their events.

Two passes, because few pixels change by a threshold between frames: the first streams over all
pixels and says how many events to make room for, the second visits the few that fire. What only
those need lies together in one record per pixel, as every visit costs a cache miss. Imperfect
pixels have `Own` thresholds, and leak; for ideal ones that is None, and numba leaves those branches
out. The loops hold no lock and start no threads of their own: cameras run side by side, the
renderer keeps the rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.sim.compensation.path_kernels import NO_ARRAYS
from eventsweep.sim.sensor.labels import Label

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


# Compiled code takes plain numbers only.
_SIGNAL, _LEAK = int(Label.SIGNAL), int(Label.LEAK)
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


@numba.njit(cache=True, nogil=True, fastmath=False, **NO_ARRAYS)
def number_of_rises(
    log: float, first: float, up: int, down: int, c_pos: float, c_neg: float
) -> int:
    """Levels above the reference that `log` reaches."""
    count = 0
    while log >= level_of(first, up + count + 1, down, c_pos, c_neg) - TIE:
        count += 1
    return count


@numba.njit(cache=True, nogil=True, fastmath=False, **NO_ARRAYS)
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


class Own(NamedTuple):
    """What imperfect pixels have of their own, (P,) each; leaks count in thresholds.

    Attributes:
        c_pos: thresholds C+.
        c_neg: thresholds C-.
        leaked_before: leaked at the interval's start.
        leaked_now: at its end.
        leaked_last: in and out, at the pixel's last crossing.
    """

    c_pos: NDArray[np.float64]
    c_neg: NDArray[np.float64]
    leaked_before: NDArray[np.float64]
    leaked_now: NDArray[np.float64]
    leaked_last: NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def find(
    light: NDArray[np.floating],
    c_pos: float,
    c_neg: float,
    own: Own | None,
    reference: NDArray[np.float64],
    memory: NDArray[np.void],
    fired: NDArray[np.int32],
    crossings: NDArray[np.int32],
) -> int:
    """Finds the pixels that see the next level above or below reached.

    Args:
        light: (P,) log intensity or the photoreceptor's output, pixels in raster order.
        c_pos: threshold C+ of ideal pixels.
        c_neg: threshold C- of ideal pixels.
        own: of imperfect pixels.
        reference: (P,) `first_log` moved by all crossings so far.
        memory: (P,) records of `PIXEL`.
        fired: out, (P,) of which the first n are filled: indices of those pixels.
        crossings: out, likewise: how many thresholds each passed, negative for falls.

    Returns:
        n.
    """
    # Who may fire is written down without a branch, which would be foreseen wrongly.
    near = 0
    for k in range(len(light)):
        pos, neg, seen = c_pos, c_neg, np.float64(light[k])
        if own is not None:
            pos, neg = own.c_pos[k], own.c_neg[k]
            seen += pos * own.leaked_now[k]
        change = seen - reference[k]
        fired[near] = k
        near += int(change >= pos - NEAR) | int(change <= NEAR - neg)
    n = 0
    for m in range(near):
        k = fired[m]
        pos, neg, seen = c_pos, c_neg, np.float64(light[k])
        if own is not None:
            pos, neg = own.c_pos[k], own.c_neg[k]
            seen += pos * own.leaked_now[k]
        first, up, down = np.float64(memory[k].first_log), memory[k].up, memory[k].down
        if seen > reference[k]:
            count = number_of_rises(seen, first, up, down, pos, neg)
        else:
            count = -number_of_falls(seen, first, up, down, pos, neg)
        if count != 0:
            fired[n], crossings[n] = k, count
            n += 1
    return n


@numba.njit(cache=True, nogil=True)
def emit(
    light_before: NDArray[np.floating],
    light_now: NDArray[np.floating],
    c_pos: float,
    c_neg: float,
    own: Own | None,
    reference: NDArray[np.float64],
    memory: NDArray[np.void],
    fired: NDArray[np.int32],
    crossings: NDArray[np.int32],
    step_us: int,
    pixel: NDArray[np.int32],
    offset_us: NDArray[np.int64],
    p: NDArray[np.uint8],
    label: NDArray[np.uint8],
) -> None:
    """Fills one event per crossing and moves the pixels' memory on.

    Args:
        light_before: (P,) what `find` calls light, at the interval's start.
        light_now: (P,) at its end.
        c_pos: threshold C+ of ideal pixels.
        c_neg: threshold C- of ideal pixels.
        own: in and out, of imperfect pixels.
        reference: in and out, (P,).
        memory: in and out, (P,) records of `PIXEL`; last emissions are left alone, see `awake`.
        fired: (n,) pixels, from `find`.
        crossings: (n,) their crossings, from `find`.
        step_us: interval, µs.
        pixel: out, (N,) pixels.
        offset_us: out, (N,) time after the interval's start, 1 to `step_us`.
        p: out, (N,) 1 for a rise, 0 for a fall.
        label: out, (N,) `Label.SIGNAL` or `Label.LEAK` of imperfect pixels.
    """
    event = 0
    for n in range(len(fired)):
        k, rises = fired[n], crossings[n] > 0
        pos, neg = c_pos, c_neg
        before, now = np.float64(light_before[k]), np.float64(light_now[k])
        if own is not None:
            pos, neg = own.c_pos[k], own.c_neg[k]
            before += pos * own.leaked_before[k]
            now += pos * own.leaked_now[k]
        slope = now - before
        first, up, down = np.float64(memory[k].first_log), memory[k].up, memory[k].down
        level = level_of(first, up, down, pos, neg)
        for _ in range(abs(crossings[n])):
            lit_last, crossed = level, up + down > 0
            if rises:
                up += 1
            else:
                down += 1
            level = level_of(first, up, down, pos, neg)
            pixel[event], p[event] = k, rises
            offset_us[event] = crossing_offset_us(level, before, slope, step_us)
            if own is not None:
                way = own.leaked_now[k] - own.leaked_before[k]
                leaked = own.leaked_before[k] + (level - before) / slope * way
                if crossed:
                    lit_last -= pos * own.leaked_last[k]
                lit = level - pos * leaked
                leaky = pos * (leaked - own.leaked_last[k]) > lit - lit_last
                label[event] = _LEAK if rises and leaky else _SIGNAL
                own.leaked_last[k] = leaked
            event += 1
        memory[k].up, memory[k].down = up, down
        reference[k] = level


@numba.njit(cache=True, nogil=True)
def awake(
    pixel: NDArray[np.integer],
    t_us: NDArray[np.int64],
    refractory_us: int,
    last_us: NDArray[np.int64],
    kept: NDArray[np.bool_],
) -> None:
    """Marks the events (N,) in order of time that do not fall into a pixel's silence.

    Args:
        pixel: (N,) pixels.
        t_us: (N,) times, µs.
        refractory_us: least time between two kept events of a pixel, µs.
        last_us: in and out, (P,) time of the pixel's last kept event, µs.
        kept: out, (N,).
    """
    for i in range(len(pixel)):
        kept[i] = t_us[i] - last_us[pixel[i]] >= refractory_us
        if kept[i]:
            last_us[pixel[i]] = t_us[i]


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
