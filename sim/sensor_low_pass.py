"""The photoreceptor: a low-pass filter that is faster in bright light, as one compiled loop."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray


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
