"""The compiled loop that keeps the nearest point of each pixel."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)


@njit(cache=True)
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
