"""The compiled loop of the network's inputs: votes of cameras into shares of the largest."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

import numpy as np
from numba import njit, prange

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

_LEAST_VOTES, _ONE, _ZERO = np.float32(1e-6), np.float32(1), np.float32(0)


@njit(parallel=True, cache=True)
def shares(fused, cameras, out):
    """Fills `out` with fused votes, the first camera's and the mean of the others, as shares.

    Arrays:
        fused: (B, cells, L) float32.
        cameras: (C, B, cells, L) float32; one alone is the others, too.
        out: (B, 3, cells, L) float32, filled: votes over the largest fused one of that lane.
    """
    blocks, cells, lanes = fused.shape
    count = len(cameras)
    among = _ONE / np.float32(max(count - 1, 1))
    for b in prange(blocks):
        scale = np.full(lanes, _LEAST_VOTES)
        for k in range(cells):
            row = fused[b, k]
            for x in range(lanes):
                scale[x] = max(scale[x], row[x])
        for x in range(lanes):
            scale[x] = _ONE / scale[x]
        for k in range(cells):
            whole, one, first = out[b, 0, k], out[b, 1, k], cameras[0, b, k]
            votes, others = fused[b, k], out[b, 2, k]
            for x in range(lanes):
                whole[x] = votes[x] * scale[x]
                one[x] = first[x] * scale[x]
                others[x] = _ZERO if count > 1 else first[x]
            for c in range(1, count):
                row = cameras[c, b, k]
                for x in range(lanes):
                    others[x] += row[x]
            for x in range(lanes):
                others[x] *= among * scale[x]
