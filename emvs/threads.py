"""Numba's threading layer, named in one place: import this before compiling a parallel kernel."""

import os

import numba

# OpenMP is safe when several Python threads call kernels; numba's own queue ends the process.
if "NUMBA_THREADING_LAYER" not in os.environ:
    numba.config.THREADING_LAYER = "omp"  # type: ignore[attr-defined]


def use_threads(count: int) -> int:
    """Sets how many threads the kernels use and returns it; 0 means all of them."""
    available = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
    chosen = min(count, available) if count > 0 else available
    numba.set_num_threads(chosen)
    return chosen
