"""The fixed loop beside which the mapper's speed is measured."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)


@njit(cache=True, nogil=True)
def calibration(image, votes):
    """Adds `votes` weights to four neighbouring cells each of `image`, (N,) float32, N = 2^k."""
    mask = np.uint32(len(image) - 1)
    state = np.uint32(12345)
    for _ in range(votes):
        state = np.uint32(state * np.uint32(1664525) + np.uint32(1013904223))
        share = np.float32(state & np.uint32(1023)) / np.float32(1024)
        cell = (state >> np.uint32(10)) & mask
        image[cell] += share
        image[(cell + np.uint32(1)) & mask] += np.float32(1) - share
        image[(cell + np.uint32(512)) & mask] += share * share
        image[(cell + np.uint32(513)) & mask] += share - share * share
