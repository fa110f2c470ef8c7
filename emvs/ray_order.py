"""Rays grouped by rows of the image, so that votes that follow each other share cache lines.

Events come in the order of time, from all over the image, and every vote of a large plane waits for
memory. Grouped by bands of rows, a thread's votes stay within a few kilobytes of its plane. The
votes are the same; only the order of their sum changes, and that is the same for any number of
threads.
"""

from __future__ import annotations

import numpy as np

from emvs.ray_kernel import BLOCK, count_bands, move_to_bands
from emvs.rays import Rays

# With fewer rows than these a thread's neighbouring votes meet in one cell and wait for each other,
# with more the band leaves the cache: docs/performance.md has the times.
BAND_ROWS = 8


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
    blocks = -(-len(rays) // BLOCK)
    place = np.zeros((blocks, bands), np.int64)
    args = rays.a_v, rays.b_v, np.float32(rho), band_rows, bands
    count_bands(*args, place)
    # Where the first ray of each band of each block goes: bands one after another, then blocks.
    before = np.cumsum(place.T).reshape(bands, blocks).T - place
    ordered = tuple(np.empty_like(column) for column in rays.columns)
    move_to_bands(*args, before, rays.columns, ordered)
    return Rays.of(ordered, rays.counts)
