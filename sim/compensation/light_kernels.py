"""Light between the nodes of a frame's grid: compiled, one position at a time."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

# Indices without a sign: there is no negative one to look for.
_ONE, _TWO = np.uint64(1), np.uint64(2)


@numba.njit(cache=True, nogil=True, inline="always")
def light_at(light: NDArray[np.float32], u: float, v: float) -> float:
    """Catmull-Rom light at column `u` and row `v` of the grid; beyond its edge that of the edge.

    It is kept between the least and the greatest of the four nodes around the place: without that
    it rings at edges of high contrast, where rings are events.
    """
    rows, columns = light.shape
    u, v = min(max(u, 1.0), columns - 2.001), min(max(v, 1.0), rows - 2.001)
    j, i = np.uint64(u), np.uint64(v)
    a0, a1, a2, a3 = _weights(np.float32(u - j))
    b0, b1, b2, b3 = _weights(np.float32(v - i))
    top, above, below, bottom = light[i - _ONE], light[i], light[i + _ONE], light[i + _TWO]
    k, m, n = j - _ONE, j + _ONE, j + _TWO
    value = (
        b0 * (a0 * top[k] + a1 * top[j] + a2 * top[m] + a3 * top[n])
        + b1 * (a0 * above[k] + a1 * above[j] + a2 * above[m] + a3 * above[n])
        + b2 * (a0 * below[k] + a1 * below[j] + a2 * below[m] + a3 * below[n])
        + b3 * (a0 * bottom[k] + a1 * bottom[j] + a2 * bottom[m] + a3 * bottom[n])
    )
    low = min(min(above[j], above[m]), min(below[j], below[m]))
    high = max(max(above[j], above[m]), max(below[j], below[m]))
    return min(max(value, low), high)  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, inline="always")
def _weights(a: np.float32) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Catmull and Rom (1974): weights of the nodes at -1, 0, 1 and 2 for a place at `a`."""
    half, one = np.float32(0.5), np.float32(1.0)
    b = one - a
    w0, w3 = -half * a * b * b, -half * b * a * a
    w1 = b * b * (one + a + a) - w3
    return w0, w1, one - w0 - w1 - w3, w3
