"""Compiled loops that copy bytes on all cores and fill arrays on the GPU.

Apart from the arrays: numba's simulator puts a double of `cuda` into the module of a kernel while
that runs, and the arrays are made by several threads.
"""

# mypy: disable-error-code="attr-defined, misc, no-any-return, no-untyped-call, no-untyped-def"

from __future__ import annotations

from numba import cuda, njit, prange

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

_PIECE = 1 << 18  # bytes that a thread copies at a time


@njit(parallel=True, cache=True)
def copy_bytes(source, target):
    """Copies (N,) uint8 by all threads."""
    for piece in prange((len(source) + _PIECE - 1) // _PIECE):
        first, last = piece * _PIECE, min((piece + 1) * _PIECE, len(source))
        target[first:last] = source[first:last]


@cuda.jit(cache=True)
def fill(array, value):
    """Fills a (P, N) array on the GPU; the grid is (blocks, P)."""
    p, c = cuda.blockIdx.y, cuda.grid(1)
    while c < array.shape[1]:
        array[p, c] = value
        c += cuda.gridDim.x * cuda.blockDim.x
