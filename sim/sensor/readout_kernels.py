"""Compiled loops of the read-out: no overtaking within a pixel, and the row arbiter."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

WAITING, SERVED, DROPPED = 0, 1, 2


@numba.njit(cache=True, nogil=True)
def in_turn(pixel: NDArray[np.int32], t_us: NDArray[np.int64], last_us: NDArray[np.int64]) -> None:
    """Holds events back until their pixel's event before has made its request.

    Args:
        pixel: (N,) pixels, in the order in which they fired.
        t_us: in and out, (N,) times of request, µs.
        last_us: in and out, (P,) the pixels' last request, µs.
    """
    for i in range(len(pixel)):
        t_us[i] = max(t_us[i], last_us[pixel[i]])
        last_us[pixel[i]] = t_us[i]


@numba.njit(cache=True, nogil=True)
def arbitrate(
    row: NDArray[np.int32],
    t_us: NDArray[np.int64],
    admitted: int,
    free_us: float,
    end_us: int,
    row_us: float,
    event_us: float,
    capacity: int,
    links: NDArray[np.int64],
    served: NDArray[np.int64],
    served_us: NDArray[np.int64],
    fate: NDArray[np.uint8],
) -> tuple[int, float]:
    """Serves requests row by row up to `end_us`: the row that has waited longest comes first.

    A service takes all waiting events of its row, which share its time stamp, and keeps the
    read-out busy for `row_us` and `event_us` for each of them. A request that finds `capacity`
    others waiting is dropped.

    Args:
        row: (N,) rows of the requests.
        t_us: (N,) their times, non-decreasing but for the first `admitted`; none after `end_us`.
        admitted: how many of them wait from earlier.
        free_us: when the read-out is free again, µs.
        end_us: services start no later.
        row_us: time per service, µs.
        event_us: time per event, µs.
        capacity: how many may wait.
        links: scratch, (3, max(N, H)): per row its first and last waiting request, and per
            request the next one of its row.
        served: out, (N,) indices in the order of service, of which the first n are filled.
        served_us: out, likewise, time stamps.
        fate: out, (N,) WAITING, SERVED or DROPPED.

    Returns:
        n, and when the read-out is free again.
    """
    first, last, following = links[0], links[1], links[2]
    turn = np.empty(len(row) + 1, np.int32)
    first[:] = -1
    turn_start, turn_end, waiting, n, i = 0, 0, 0, 0, 0
    while True:
        now = free_us
        if i >= admitted and waiting == 0:
            if i == len(row):
                break
            now = max(free_us, np.float64(t_us[i]))
        limit = min(now, np.float64(end_us))
        while i < len(row) and (i < admitted or t_us[i] <= limit):
            if i >= admitted and waiting >= capacity:
                fate[i] = DROPPED
            else:
                fate[i] = WAITING
                following[i] = -1
                if first[row[i]] < 0:
                    first[row[i]] = i
                    turn[turn_end] = row[i]
                    turn_end += 1
                else:
                    following[last[row[i]]] = i
                last[row[i]] = i
                waiting += 1
            i += 1
        if now > end_us:
            break
        if waiting == 0:
            continue
        chosen = turn[turn_start]
        turn_start += 1
        k, count = first[chosen], 0
        first[chosen] = -1
        while k >= 0:
            served[n], served_us[n], fate[k] = k, math.floor(now), SERVED
            k = following[k]
            n += 1
            count += 1
        waiting -= count
        free_us = now + row_us + count * event_us
    return n, free_us
