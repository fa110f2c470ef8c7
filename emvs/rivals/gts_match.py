"""GTS: each event looks for the one event of the other camera that coincides with it best.

Ieng et al., *Neuromorphic Event-Based Generalized Time-Based Stereovision*, Frontiers in
Neuroscience 2018: the energy of a pair sums the distance from the epipolar line, the difference in
time and the difference in motion; the fourth term, grey levels, needs a sensor that measures them.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

import emvs.threads  # noqa: F401
from emvs.rivals.parameters import Coincidence

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Stream:
    """Events of one camera in its rectified view.

    Attributes:
        uv_px: (N, 2) columns and rows.
        t_us: (N,) int64 sorted times, µs.
        p: (N,) polarities.
        slope: (N, 2) time slopes, µs/px; events with NaN match nothing.
    """

    uv_px: Floats
    t_us: Indices
    p: NDArray[np.uint8]
    slope: Floats


def pairs(
    left: Stream, right: Stream, range_px: tuple[float, float], settings: Coincidence
) -> tuple[Indices, Indices, Floats]:
    """Events that choose each other.

    Args:
        left: of camera i.
        right: of camera j.
        range_px: smallest and largest disparity.
        settings: of the energy.

    Returns:
        (K,) indices in `left`, (K,) in `right`, and (K,) energies, in the order of `left`.
    """
    low, high = range_px
    to_right, energy = _best(left, right, low, high, settings)
    to_left, _ = _best(right, left, -high, -low, settings)
    mine = np.flatnonzero(to_right >= 0)
    mutual = mine[to_left[to_right[mine]] == mine]
    return mutual, to_right[mutual], energy[mutual]


def _best(
    one: Stream, other: Stream, low: float, high: float, settings: Coincidence
) -> tuple[Indices, Floats]:
    """For each event of `one`, the best of `other` with `low <= column difference <= high`."""
    out, energy = np.empty(len(one.t_us), np.int64), np.empty(len(one.t_us))
    order, start = _by_row(other.uv_px)
    widths = settings.row_px, settings.time_us, settings.motion, settings.most_energy
    _search(
        one.uv_px, one.t_us, one.p, one.slope, other.uv_px, other.t_us, other.p, other.slope,
        order, start, low, high, widths, out, energy,
    )  # fmt: skip
    return out, energy


def _by_row(uv_px: Floats) -> tuple[Indices, Indices]:
    """Indices by row, in each row by time, and where each row begins."""
    known = np.isfinite(uv_px).all(axis=1)
    row = np.where(known, np.rint(np.where(known, uv_px[:, 1], 0)), -1).astype(np.int64)
    order = np.argsort(row, kind="stable")
    rows = int(row.max(initial=0)) + 1
    return order, np.searchsorted(row[order], np.arange(rows + 1))


@njit(cache=True)
def _energy(dv, dt, one, other, widths):
    """Energy of a pair without the check of its disparity."""
    row, time, motion, _ = widths
    length = one[0] ** 2 + one[1] ** 2 + other[0] ** 2 + other[1] ** 2
    apart = (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2
    moved = 2 * apart / (length + 1e-12)
    return (dv / row) ** 2 + (dt / time) ** 2 + moved / (motion * motion)


@njit(cache=True)
def _not_before(t_us, order, low, high, first_us):
    """First place in low..high of `order` whose event is not before `first_us`."""
    while low < high:
        half = (low + high) // 2
        if t_us[order[half]] < first_us:
            low = half + 1
        else:
            high = half
    return low


@njit(cache=True, parallel=True)
def _search(
    uv, t_us, p, slope, o_uv, o_t_us, o_p, o_slope, order, start, low, high, widths, out, energy
):
    """Fills the best partner, -1 for none, and its energy; of equals the earlier row and event."""
    row_px, time_us, _, most = widths
    reach = int(np.ceil(2 * row_px)) + 1
    for k in prange(len(t_us)):
        out[k], energy[k] = -1, most
        if np.isnan(slope[k, 0]) or np.isnan(uv[k, 0]):
            continue
        middle = int(np.floor(uv[k, 1] + 0.5))
        for row in range(max(0, middle - reach), min(len(start) - 2, middle + reach) + 1):
            first = _not_before(o_t_us, order, start[row], start[row + 1], t_us[k] - 2 * time_us)
            for n in range(first, start[row + 1]):
                m = order[n]
                if o_t_us[m] > t_us[k] + 2 * time_us:
                    break
                du, dv = uv[k, 0] - o_uv[m, 0], uv[k, 1] - o_uv[m, 1]
                if o_p[m] != p[k] or not low <= du <= high or abs(dv) > 2 * row_px:
                    continue
                if np.isnan(o_slope[m, 0]):
                    continue
                value = _energy(dv, float(o_t_us[m] - t_us[k]), slope[k], o_slope[m], widths)
                if value < energy[k]:
                    out[k], energy[k] = m, value
