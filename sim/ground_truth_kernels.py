"""The compiled loop of event depth; `sim.ground_truth.event_depth_m` checks what it is given."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)


@numba.njit(cache=True, nogil=True)
def fill_event_depth(
    before_m: NDArray[np.float32],
    after_m: NDArray[np.float32],
    before_us: int,
    after_us: int,
    places: NDArray[np.int32],
    t_us: NDArray[np.int64],
    same: float,
    depth_m: NDArray[np.float32],
) -> None:
    """Fills `depth_m` (N,) with the z-depth at each event's pixel and time.

    Args:
        before_m: (H, W) nearest depth of each pixel's samples in the frame before, m; inf for none.
        after_m: (H, W) the same in the frame behind.
        before_us: time of the frame before, µs.
        after_us: time of the frame behind, µs.
        places: (N, 4) column and row where each event's surface lies in the frame before, and in
            the frame behind.
        t_us: (N,) their times, up to `after_us`; before the interval counts as its beginning, µs.
        same: inverse depths that differ by up to this share belong to one surface, whose inverse
            depth is interpolated linearly; otherwise an edge passed and the nearer one is taken.
        depth_m: out, (N,), m.
    """
    for n in range(len(t_us)):
        a = 1.0 / np.float64(before_m[places[n, 1], places[n, 0]])
        b = 1.0 / np.float64(after_m[places[n, 3], places[n, 2]])
        rho = max(a, b)
        if abs(a - b) <= same * rho:
            # A sensor's coarse clock may say less than the time of the frame before.
            share = max(0.0, (t_us[n] - before_us) / (after_us - before_us))
            rho = a + share * (b - a)
        depth_m[n] = 1.0 / rho if rho > 0.0 else np.inf
