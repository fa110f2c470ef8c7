"""GTS: each event looks for the one event of the other camera that coincides with it best.

Ieng et al., *Neuromorphic Event-Based Generalized Time-Based Stereovision*, Frontiers in
Neuroscience 2018: the energy of a pair sums the distance from the epipolar line, the difference in
time and the difference in motion; the fourth term, grey levels, needs a sensor that measures them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs.rivals.gts_kernels import search
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
    search(
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
