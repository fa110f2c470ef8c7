"""The compiled loop of the masked median. Arrays in, `out` filled, nothing else."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit, prange

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)


@njit(cache=True)
def _lower_median(values, count):
    """The (count - 1) // 2-th smallest of the first `count` values, by quickselect in place."""
    want, lo, hi = (count - 1) // 2, 0, count - 1
    while lo < hi:
        pivot, i, j = values[(lo + hi) // 2], lo, hi
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if want <= j:
            hi = j
        elif want >= i:
            lo = i
        else:
            break
    return values[want]


@njit(parallel=True, cache=True)
def masked_median(values, mask, radius, patch, out):
    """Fills `out` at mask pixels; row y uses `patch[y]`, (2 radius + 1)² + 1 values, as scratch."""
    height, width = values.shape
    for y in prange(height):
        row, top, bottom = patch[y], max(y - radius, 0), min(y + radius + 1, height)
        for x in range(width):
            if not mask[y, x]:
                continue
            count = np.int64(0)  # a literal would be compiled for, too
            for v in range(top, bottom):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    # Without a branch: what is outside the mask is overwritten by the next.
                    row[count] = values[v, u]
                    count += mask[v, u]
            out[y, x] = _lower_median(row, count)
