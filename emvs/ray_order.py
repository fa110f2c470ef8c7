"""Rays grouped by rows of the image, so that votes that follow each other share cache lines.

Events come in the order of time, from all over the image, and every vote of a large plane waits for
memory. Grouped by bands of rows, a thread's votes stay within a few kilobytes of its plane. The
votes are the same; only the order of their sum changes, and that is the same for any number of
threads.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

from __future__ import annotations

import numpy as np
from numba import njit, prange

import emvs.threads  # noqa: F401  (names the threading layer before the kernels compile)
from emvs.rays import Rays

# With fewer rows than these a thread's neighbouring votes meet in one cell and wait for each other,
# with more the band leaves the cache: docs/performance.md has the times.
BAND_ROWS = 8
_BLOCK = 1 << 17


def grouped_by_rows(rays: Rays, rho: float, height_px: int, band_rows: int = BAND_ROWS) -> Rays:
    """Groups rays by bands of the image rows where they meet one plane, stably.

    Args:
        rays: one camera's rays.
        rho: the plane's inverse depth, 1/m; a middle one keeps all planes' votes near together.
        height_px: rows of the reference view.
        band_rows: rows of a band.

    Returns:
        The same rays in another order; those above, below or nowhere come first or last.
    """
    bands = -(-height_px // band_rows)
    blocks = -(-len(rays) // _BLOCK)
    place = np.zeros((blocks, bands), np.int64)
    args = rays.a_v, rays.b_v, np.float32(rho), band_rows, bands
    count_bands(*args, place)
    # Where the first ray of each band of each block goes: bands one after another, then blocks.
    before = np.cumsum(place.T).reshape(bands, blocks).T - place
    ordered = tuple(np.empty_like(column) for column in rays.columns)
    move_to_bands(*args, before, rays.columns, ordered)
    return Rays.of(ordered, rays.counts)


@njit(cache=True)
def _band(v, rows, bands):
    """The band of image row `v`; what lies outside the image, or nowhere, goes to the ends."""
    if not v > np.float32(0):
        return 0
    return bands - 1 if v >= np.float32(rows * bands) else np.int64(v) // rows


@njit(parallel=True, cache=True)
def count_bands(a_v, b_v, rho, rows, bands, counts):
    """Counts each block's rays by band.

    Arrays:
        a_v, b_v: (N,) float32.
        counts: (blocks, bands) int64 zeros, filled.
    """
    for block in prange(counts.shape[0]):
        for k in range(block * _BLOCK, min((block + 1) * _BLOCK, len(a_v))):
            counts[block, _band(a_v[k] + rho * b_v[k], rows, bands)] += 1


@njit(parallel=True, cache=True)
def move_to_bands(a_v, b_v, rho, rows, bands, place, columns, ordered):
    """Moves each ray to the next free place of its band.

    Arrays:
        a_v, b_v: (N,) float32.
        place: (blocks, bands) int64, where each block's first ray of a band goes; counted up.
        columns, ordered: five (N,) float32 each, read and filled.
    """
    for block in prange(place.shape[0]):
        for k in range(block * _BLOCK, min((block + 1) * _BLOCK, len(a_v))):
            band = _band(a_v[k] + rho * b_v[k], rows, bands)
            to = place[block, band]
            place[block, band] = to + 1
            ordered[0][to] = columns[0][k]
            ordered[1][to] = columns[1][k]
            ordered[2][to] = columns[2][k]
            ordered[3][to] = columns[3][k]
            ordered[4][to] = columns[4][k]
