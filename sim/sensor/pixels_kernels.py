"""Compiled loops of imperfect pixels: photoreceptor and leak.

The comparator (`sim.sensor.esim_kernels`) sees the photoreceptor's output plus what has leaked.
Like its loops these hold no lock and start no threads.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

# Least difference of numbers of 53 bits in [0, 1).
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
    pace: NDArray[np.float64],
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
        pace: (P,) how many times faster than that each pixel leaks: by its light, and by itself.
        speed: in and out, (P,) present speed, thresholds per second.
        before: (P,) thresholds leaked at the interval's start.
        now: out, (P,) at its end.
    """
    for k in range(len(now)):
        leaked, left_s = before[k], step_s * pace[k]
        after = leaked + left_s * speed[k]
        slot = math.floor(leaked)
        while after >= slot + 1:
            left_s -= (slot + 1 - leaked) / speed[k]
            slot += 1
            leaked = np.float64(slot)
            speed[k] = leak_speed(key, k, slot, rate_hz, jitter)
            after = leaked + max(left_s, 0.0) * speed[k]
        now[k] = after


@numba.njit(cache=True, nogil=True, inline="always")
def _decay(h: float) -> float:
    """exp(-h) for h >= 0 within 1e-7, without a call, so that loops over pixels run in parallel."""
    y = -min(h, 44.0) / 64.0
    e = 1.0 + y * (1.0 / 9) * (1.0 + y * (1.0 / 10))
    e = 1.0 + y * (1.0 / 7) * (1.0 + y * (1.0 / 8) * e)
    e = 1.0 + y * (1.0 / 5) * (1.0 + y * (1.0 / 6) * e)
    e = 1.0 + y * (1.0 / 3) * (1.0 + y * (1.0 / 4) * e)
    e = 1.0 + y * (1.0 + y * (1.0 / 2) * e)
    e2 = e * e
    e4 = e2 * e2
    e8 = e4 * e4
    e16 = e8 * e8
    e32 = e16 * e16
    return e32 * e32


@numba.njit(cache=True, nogil=True, error_model="numpy")
def low_pass(
    log_before: NDArray[np.float32],
    log_now: NDArray[np.float32],
    light_before: NDArray[np.float32],
    light_now: NDArray[np.float32],
    decay_at_one: float,
    dark_level: float,
    order: int,
    inner: NDArray[np.float64],
    before: NDArray[np.float64],
    now: NDArray[np.float64],
) -> None:
    """Filters the input, linear in between, by equal poles whose cut-off grows with intensity.

    The solution of the differential equation is exact for any interval, but that a pixel's cut-off
    is that of its mean intensity over the interval.

    Args:
        log_before: (P,) input at the interval's start.
        log_now: (P,) input at its end.
        light_before: (P,) intensity at its start.
        light_now: (P,) intensity at its end.
        decay_at_one: interval over time constant, at intensity 1.
        dark_level: added to intensity.
        order: 1 or 2 poles.
        inner: in and out, (P,) output of the first of two poles; not used for one.
        before: (P,) output at the interval's start.
        now: out, (P,) output at its end.
    """
    # Nothing here divides by zero: without Python's check for it the loops become vector code.
    scale = decay_at_one / (1.0 + dark_level)
    if order == 1:
        for k in range(len(now)):
            start = np.float64(log_before[k])
            rise = np.float64(log_now[k]) - start
            mean = 0.5 * (np.float64(light_before[k]) + np.float64(light_now[k]))
            h = scale * (mean + dark_level)
            e = _decay(h)
            now[k] = start + rise * (1.0 - (1.0 - e) / h) + (before[k] - start) * e
    else:
        for k in range(len(now)):
            start = np.float64(log_before[k])
            rise = np.float64(log_now[k]) - start
            mean = 0.5 * (np.float64(light_before[k]) + np.float64(light_now[k]))
            h = scale * (mean + dark_level)
            e = _decay(h)
            lag = (1.0 - e) / h
            first = inner[k] - start
            inner[k] = start + rise * (1.0 - lag) + first * e
            now[k] = start + rise * (1.0 + e - 2.0 * lag) + e * (first * h + before[k] - start)
