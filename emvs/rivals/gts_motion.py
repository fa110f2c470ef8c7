"""Image motion per event, from the times of its neighbours: GTS asks matches to move alike.

A plane through the last event times around an event has a slope in µs per pixel, whose inverse is
the normal flow (Benosman et al., *Event-based visual flow*, TNNLS 2014).
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_NEVER = -1
_LEAST = 6  # neighbours that a plane needs, the event itself included


def time_slopes(
    pixels: NDArray[np.int64], t_us: NDArray[np.int64], p: NDArray[np.uint8],
    size_px: tuple[int, int], radius_px: int, memory_us: int,
) -> Floats:  # fmt: skip
    """Slope of the last event times around each event, of its own polarity.

    Args:
        pixels: (N, 2) int64 columns and rows; negative columns for events that are left out.
        t_us: (N,) sorted times, 0 or more, µs.
        p: (N,) polarities, 0 or 1.
        size_px: (width, height) that holds all pixels.
        radius_px: half a side of the neighbourhood.
        memory_us: how old a neighbour may be, µs.

    Returns:
        (N, 2) slopes by column and by row, µs/px; NaN where too few neighbours fired.
    """
    last = np.full((2, size_px[1], size_px[0]), _NEVER, np.int64)
    out = np.empty((len(t_us), 2))
    _fit(pixels, t_us, p, radius_px, memory_us, last, out)
    return out


@njit(cache=True)
def _fit(pixels, t_us, p, radius, memory_us, last, out):
    """Stamps each event and fits a plane by least squares, relative to the event."""
    _, height, width = last.shape
    for k in range(len(t_us)):
        u, v = pixels[k, 0], pixels[k, 1]
        out[k, 0], out[k, 1] = np.nan, np.nan
        if u < 0:
            continue
        last[p[k], v, u] = t_us[k]
        n, sx, sy, st, sxx, syy, sxy, sxt, syt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(max(0, v - radius), min(height, v + radius + 1)):
            for i in range(max(0, u - radius), min(width, u + radius + 1)):
                when = last[p[k], j, i]
                if when == _NEVER or t_us[k] - when > memory_us:
                    continue
                x, y, t = float(i - u), float(j - v), float(when - t_us[k])
                n += 1
                sx += x
                sy += y
                st += t
                sxx += x * x
                syy += y * y
                sxy += x * y
                sxt += x * t
                syt += y * t
        if n < _LEAST:
            continue
        xx, yy, xy = sxx - sx * sx / n, syy - sy * sy / n, sxy - sx * sy / n
        xt, yt = sxt - sx * st / n, syt - sy * st / n
        det = xx * yy - xy * xy
        if det > 1e-9 * max(xx * yy, 1.0):
            out[k, 0], out[k, 1] = (xt * yy - yt * xy) / det, (yt * xx - xt * xy) / det
