"""Which events a map of ESVO looks at: the newest ones, one per pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events


def newest(events: Events, most: int, width_px: int) -> NDArray[np.int64]:
    """Picks events; older ones of the same pixel lie on a time surface that has moved on.

    Args:
        events: sorted by time.
        most: how many to take at most.
        width_px: columns of the sensor.

    Returns:
        (K,) int64 indices in order of time, each pixel once.
    """
    pixel = events.y.astype(np.int64) * width_px + events.x
    _, from_the_end = np.unique(pixel[::-1], return_index=True)
    last = len(events) - 1 - np.sort(from_the_end)[:most]
    return np.sort(last).astype(np.int64)
