"""The compiled loops of time surfaces: the latest event of each pixel, and its decay."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

NEVER_US = np.iinfo(np.int64).min


@njit(cache=True)
def stamp(x, y, t_us, out):
    """Writes each event's time to its pixel; later events overwrite earlier ones."""
    for k in range(len(t_us)):
        out[y[k], x[k]] = t_us[k]


@njit(cache=True)
def decay(last_us, t_us, decay_us, out):
    """Fills `out` with the decayed age of every pixel."""
    height, width = last_us.shape
    for v in range(height):
        for u in range(width):
            out[v, u] = 0.0
            if last_us[v, u] != NEVER_US:
                out[v, u] = np.exp((last_us[v, u] - t_us) / decay_us)
