"""The compiled loops of GTS: the search for coinciding events, and their image motion."""

# mypy: disable-error-code="no-any-return, no-untyped-call, no-untyped-def"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

NEVER = -1
_LEAST = 6  # neighbours that a plane needs, the event itself included


@njit(cache=True, nogil=True)
def _energy(dv, dt, one, other, widths):
    """Energy of a pair without the check of its disparity."""
    row, time, motion, _ = widths
    length = one[0] ** 2 + one[1] ** 2 + other[0] ** 2 + other[1] ** 2
    apart = (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2
    moved = 2 * apart / (length + 1e-12)
    return (dv / row) ** 2 + (dt / time) ** 2 + moved / (motion * motion)


@njit(cache=True, nogil=True)
def _not_before(t_us, low, high, first_us):
    """First of the sorted times low..high that is not before `first_us`."""
    while low < high:
        half = (low + high) // 2
        if t_us[half] < first_us:
            low = half + 1
        else:
            high = half
    return low


@njit(cache=True, nogil=True)
def search(
    first, last, p, uv, t_us, slope, start, o_uv, o_t_us, o_slope, low, high, widths, out, energy
):
    """Fills the best partner, -1 for none, and its energy, of events `first` to `last`.

    Events of both cameras are sorted by polarity, row and time; `start` (2, rows + 1) says where
    each row of the other camera begins. Of equals it takes the earlier row and event.
    """
    row_px, time_us, _, most = widths
    # A pair that is further apart in row or time has more than the largest energy by that alone.
    far = min(2.0, np.sqrt(most) * (1 + 1e-9))
    reach = int(far * row_px) + 1
    for k in range(first, last):
        out[k], energy[k] = -1, most
        rows = start[p[k]]
        middle = int(np.rint(uv[k, 1]))
        for row in range(max(0, middle - reach), min(len(rows) - 2, middle + reach) + 1):
            begin = _not_before(o_t_us, rows[row], rows[row + 1], t_us[k] - far * time_us)
            for m in range(begin, rows[row + 1]):
                if o_t_us[m] > t_us[k] + far * time_us:
                    break
                du, dv = uv[k, 0] - o_uv[m, 0], uv[k, 1] - o_uv[m, 1]
                if not low <= du <= high or abs(dv) > far * row_px:
                    continue
                value = _energy(dv, float(o_t_us[m] - t_us[k]), slope[k], o_slope[m], widths)
                if value < energy[k]:
                    out[k], energy[k] = m, value


@njit(cache=True, nogil=True)
def fit(pixels, t_us, p, radius, memory_us, last, out):
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
                if when == NEVER or t_us[k] - when > memory_us:
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
