"""Image motion per event, from the times of its neighbours: GTS asks matches to move alike.

A plane through the last event times around an event has a slope in µs per pixel, whose inverse is
the normal flow (Benosman et al., *Event-based visual flow*, TNNLS 2014).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.rivals.gts_kernels import NEVER, fit

Floats = NDArray[np.float64]


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
    last = np.full((2, size_px[1], size_px[0]), NEVER, np.int64)
    out = np.empty((len(t_us), 2))
    fit(pixels, t_us, p, radius_px, memory_us, last, out)
    return out
