"""The compiled loop of the objective: each ray's largest harmonic mean of the cameras' votes.

A thread owns a window: it casts, fuses and folds one plane after the other, in memory that stays in
its cache. So one call does all, and the sums do not depend on the number of threads.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import numpy as np
from numba import njit, prange

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

_ZERO, _ONE = np.float32(0), np.float32(1)


@njit(cache=True)
def _cast(a_u, b_u, a_v, b_v, c_z, rho, width, height, grid):
    """Adds the bilinear votes of one camera's rays in plane `rho` to the cleared (cells,) grid."""
    u_end, v_end = np.float32(width - 1), np.float32(height - 1)
    grid[:] = _ZERO
    for k in range(len(a_u)):
        u = a_u[k] + rho * b_u[k]
        v = a_v[k] + rho * b_v[k]
        inside = (u >= _ZERO) & (v >= _ZERO) & (u < u_end) & (v < v_end)
        if inside & (_ONE - c_z[k] * rho > _ZERO):
            column, row = np.int64(u), np.int64(v)
            right, down = u - np.float32(column), v - np.float32(row)
            cell = row * width + column
            left, up = _ONE - right, _ONE - down
            grid[cell] += left * up
            grid[cell + 1] += right * up
            grid[cell + width] += left * down
            grid[cell + width + 1] += right * down


@njit(cache=True, error_model="numpy")
def _fold(grids, best):
    """Raises each pixel's maximum by the harmonic mean of the cameras' votes."""
    cameras = grids.shape[0]
    if cameras == 2:  # most rigs: one division instead of three
        for k in range(len(best)):
            both = grids[0, k] + grids[1, k]
            mean = np.float32(2) * grids[0, k] * grids[1, k] / max(both, np.float32(1e-20))
            best[k] = max(best[k], mean)
        return
    for k in range(len(best)):
        inverse = _ZERO
        for camera in range(cameras):
            inverse += _ONE / grids[camera, k]
        best[k] = max(best[k], np.float32(cameras) / inverse)


@njit(parallel=True, cache=True)
def ray_maxima(a_u, b_u, a_v, b_v, c_z, begin, rho, width, height, grids, best):
    """The largest harmonic mean of votes along each ray of the view, of several windows.

    Arrays:
        a_u, b_u, a_v, b_v, c_z: (N,) float32, rays of all windows and cameras one after another.
        begin: (W, C + 1) int64, where each camera's rays of each window begin, and the last end.
        rho: (P,) float32 planes, 1/m.
        grids: (W, C, width * height) float32, scratch.
        best: (W, width * height) float32, filled.
    """
    for w in prange(best.shape[0]):
        best[w] = _ZERO
        for p in range(len(rho)):
            for c in range(grids.shape[1]):
                i, j = begin[w, c], begin[w, c + 1]
                _cast(
                    a_u[i:j], b_u[i:j], a_v[i:j], b_v[i:j], c_z[i:j], rho[p], width, height,
                    grids[w, c],
                )  # fmt: skip
            _fold(grids[w], best[w])
