"""The compiled loops over pixels: the latest event of each, its decay, and its nearest point."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

NEVER_US = np.iinfo(np.int64).min


@njit(cache=True, nogil=True)
def stamp(x, y, t_us, out):
    """Writes each event's time to its pixel; later events overwrite earlier ones."""
    for k in range(len(t_us)):
        out[y[k], x[k]] = t_us[k]


@njit(cache=True, nogil=True)
def decay(last_us, t_us, decay_us, out):
    """Fills `out` with the decayed age of every pixel."""
    height, width = last_us.shape
    for v in range(height):
        for u in range(width):
            out[v, u] = 0.0
            if last_us[v, u] != NEVER_US:
                out[v, u] = np.exp((last_us[v, u] - t_us) / decay_us)


@njit(cache=True, nogil=True)
def splat(points_rv, values, K, depth_m, value):
    """Fills `depth_m` and `value` with the nearest point of each pixel; of equals the first."""
    height, width = depth_m.shape
    for k in range(len(points_rv)):
        z = points_rv[k, 2]
        if not z > 0:
            continue
        column = K[0, 0] * points_rv[k, 0] / z + K[0, 2]
        row = K[1, 1] * points_rv[k, 1] / z + K[1, 2]
        if not (-0.5 <= column < width - 0.5 and -0.5 <= row < height - 0.5):
            continue
        u, v = int(np.floor(column + 0.5)), int(np.floor(row + 0.5))
        nearer = np.float32(z)
        if depth_m[v, u] == 0 or nearer < depth_m[v, u]:
            depth_m[v, u] = nearer
            value[v, u] = values[k]
