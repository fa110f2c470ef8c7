"""Fills an array on the GPU.

Alone in its module: numba's simulator puts a double of `cuda` into the module of a kernel while
that runs, and the arrays are made by several threads.
"""

# mypy: disable-error-code="no-untyped-def, attr-defined, no-untyped-call, misc"

from __future__ import annotations

from numba import cuda


@cuda.jit(cache=True)
def fill(array, value):
    """Fills a (P, N) array on the GPU; the grid is (blocks, P)."""
    p, c = cuda.blockIdx.y, cuda.grid(1)
    while c < array.shape[1]:
        array[p, c] = value
        c += cuda.gridDim.x * cuda.blockDim.x
