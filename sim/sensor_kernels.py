"""Compiled loops of imperfect pixels: leak, comparator, refractory period.

The comparator sees the photoreceptor's output plus what has leaked. Like the ideal pixel's loops
(`sim.esim_kernels`) these hold no lock and start no threads.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from sim.esim_kernels import level_of, number_of_falls, number_of_rises

_LEAK = 1
_UNIT = 2.0**-53


@numba.njit(cache=True, nogil=True, inline="always")
def _mixed(z: np.uint64) -> np.uint64:
    """SplitMix64's output function (Steele, Lea, Flood, OOPSLA 2014)."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@numba.njit(cache=True, nogil=True)
def normal(key: np.uint64, pixel: int, slot: int) -> float:
    """A standard normal number that belongs to a pixel and a slot (Box and Muller)."""
    z = _mixed(key + np.uint64(pixel) * np.uint64(0x9E3779B97F4A7C15))
    z = _mixed(z + np.uint64(slot + 1) * np.uint64(0xD1B54A32D192ED03))
    a = (np.float64(z >> np.uint64(11)) + 1.0) * _UNIT
    b = np.float64(_mixed(z + np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(11)) * _UNIT
    return math.sqrt(-2.0 * math.log(a)) * math.cos(2.0 * math.pi * b)


@numba.njit(cache=True, nogil=True)
def leak_speed(key: np.uint64, pixel: int, slot: int, rate_hz: float, jitter: float) -> float:
    """Thresholds per second at which a pixel leaks on its way from `slot` to `slot` + 1."""
    return rate_hz / max(1.0 + jitter * normal(key, pixel, slot), 0.05)


@numba.njit(cache=True, nogil=True)
def leak_speeds(key: np.uint64, rate_hz: float, jitter: float, speed: NDArray[np.float64]) -> None:
    """Fills `speed` (P,) with every pixel's first leak speed, thresholds per second."""
    for k in range(len(speed)):
        speed[k] = leak_speed(key, k, 0, rate_hz, jitter)


@numba.njit(cache=True, nogil=True)
def leak(
    key: np.uint64,
    rate_hz: float,
    jitter: float,
    step_s: float,
    speed: NDArray[np.float64],
    before: NDArray[np.float64],
    now: NDArray[np.float64],
) -> None:
    """Moves every pixel's leak on; the time for each threshold is drawn anew.

    Args:
        key: of this camera.
        rate_hz: mean leak events per second.
        jitter: standard deviation of the time for one threshold, share of its mean.
        step_s: interval, s.
        speed: in and out, (P,) present speed, thresholds per second.
        before: (P,) thresholds leaked at the interval's start.
        now: out, (P,) at its end.
    """
    for k in range(len(now)):
        leaked, left_s = before[k], step_s
        after = leaked + left_s * speed[k]
        slot = math.floor(leaked)
        while after >= slot + 1:
            left_s -= (slot + 1 - leaked) / speed[k]
            slot += 1
            leaked = np.float64(slot)
            speed[k] = leak_speed(key, k, slot, rate_hz, jitter)
            after = leaked + max(left_s, 0.0) * speed[k]
        now[k] = after


@numba.njit(cache=True, nogil=True)
def find(
    light: NDArray[np.float64],
    leaked: NDArray[np.float64],
    c_pos: NDArray[np.float64],
    c_neg: NDArray[np.float64],
    reference: NDArray[np.float64],
    memory: NDArray[np.void],
    fired: NDArray[np.int32],
    crossings: NDArray[np.int32],
) -> int:
    """As `esim_kernels.find`, with thresholds per pixel and leak.

    Args:
        light: (P,) the photoreceptor's output.
        leaked: (P,) thresholds leaked so far.
        c_pos: (P,) thresholds C+.
        c_neg: (P,) thresholds C-.
        reference: (P,) first output moved by all crossings so far.
        memory: (P,) records of `PIXEL`.
        fired: out, (P,) of which the first n are filled.
        crossings: out, likewise: thresholds passed, negative for falls.

    Returns:
        n.
    """
    n = 0
    for k in range(len(light)):
        seen = light[k] + c_pos[k] * leaked[k]
        change = seen - reference[k]
        if change < c_pos[k] and -change < c_neg[k]:
            continue
        first, up, down = memory[k].first_log, memory[k].up, memory[k].down
        fired[n] = k
        if change >= c_pos[k]:
            crossings[n] = number_of_rises(seen, first, up, down, c_pos[k], c_neg[k])
        else:
            crossings[n] = -number_of_falls(seen, first, up, down, c_pos[k], c_neg[k])
        n += 1
    return n


@numba.njit(cache=True, nogil=True)
def emit(
    light_before: NDArray[np.float64],
    light_now: NDArray[np.float64],
    leaked_before: NDArray[np.float64],
    leaked_now: NDArray[np.float64],
    c_pos: NDArray[np.float64],
    c_neg: NDArray[np.float64],
    reference: NDArray[np.float64],
    leaked_last: NDArray[np.float64],
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
        light_before: (P,) the photoreceptor's output at the interval's start.
        light_now: (P,) at its end.
        leaked_before: (P,) thresholds leaked at the interval's start.
        leaked_now: (P,) at its end.
        c_pos: (P,) thresholds C+.
        c_neg: (P,) thresholds C-.
        reference: in and out, (P,).
        leaked_last: in and out, (P,) thresholds leaked at the pixel's last crossing.
        memory: in and out, (P,) records of `PIXEL`; last emissions are left alone.
        fired: (n,) pixels, from `find`.
        crossings: (n,) their crossings, from `find`.
        step_us: interval, µs.
        pixel: out, (N,) pixels.
        offset_us: out, (N,) time after the interval's start, 1 to `step_us`.
        p: out, (N,) 1 for a rise, 0 for a fall.
        label: out, (N,) `Label.SIGNAL` or `Label.LEAK`.
    """
    event = 0
    for n in range(len(fired)):
        k = fired[n]
        first, up, down = memory[k].first_log, memory[k].up, memory[k].down
        before = light_before[k] + c_pos[k] * leaked_before[k]
        slope = light_now[k] + c_pos[k] * leaked_now[k] - before
        lit_last = np.float64(first)
        if up + down > 0:
            lit_last = level_of(first, up, down, c_pos[k], c_neg[k]) - c_pos[k] * leaked_last[k]
        for _ in range(abs(crossings[n])):
            if crossings[n] > 0:
                up += 1
            else:
                down += 1
            level = level_of(first, up, down, c_pos[k], c_neg[k])
            share = (level - before) / slope
            leaked = leaked_before[k] + share * (leaked_now[k] - leaked_before[k])
            lit = level - c_pos[k] * leaked
            pixel[event], p[event] = k, crossings[n] > 0
            offset_us[event] = min(max(int(np.rint(share * step_us)), 1), step_us)
            leaky = c_pos[k] * (leaked - leaked_last[k]) > lit - lit_last
            label[event] = _LEAK if crossings[n] > 0 and leaky else 0
            leaked_last[k], lit_last = leaked, lit
            event += 1
        memory[k].up, memory[k].down = up, down
        reference[k] = level_of(first, up, down, c_pos[k], c_neg[k])


@numba.njit(cache=True, nogil=True)
def awake(
    pixel: NDArray[np.int32],
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
