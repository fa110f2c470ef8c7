"""The compiled loops of the extraction by focus. Arrays in, state filled, nothing else."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

import numpy as np
from numba import njit, prange

import emvs.threads  # noqa: F401  (names the threading layer before the kernels compile)


@njit(parallel=True, cache=True)
def fold_peak(value, plane, best, index, left, right, previous):
    """Folds plane number `plane` of one volume into its first maximum and both neighbours.

    All (H, W): value float32; best starts at -inf and index (int16) at -2.
    """
    height, width = value.shape
    for y in prange(height):
        for x in range(width):
            now = value[y, x]
            if index[y, x] == plane - 1:
                right[y, x] = now
            if now > best[y, x]:
                best[y, x] = now
                index[y, x] = plane
                left[y, x] = previous[y, x]
                right[y, x] = now
            previous[y, x] = now


@njit(parallel=True, cache=True)
def support(position, candidate, radius, tolerance, out):
    """Fills `out` with the share of candidates in a square that agree with its middle.

    position (H, W) float32 planes; candidate (H, W) bool; a candidate agrees where it lies less
    than `tolerance` planes away. The middle itself does not count; alone it has support 0.
    """
    height, width = position.shape
    for y in prange(height):
        for x in range(width):
            agree, there = 0, 0
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    if candidate[v, u] and not (v == y and u == x):
                        there += 1
                        agree += abs(position[v, u] - position[y, x]) < tolerance
            out[y, x] = np.float32(agree / there) if there > 0 else np.float32(0)
