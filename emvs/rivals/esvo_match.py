"""ESVO's first guess: blocks of the left time surface, searched along the right one's row.

Zhou, Gallego, Shen, TRO 2021, section IV: zero-mean normalised cross-correlation (ZNCC), coarse to
fine, gives the inverse depth from which the refinement starts.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

import emvs.threads  # noqa: F401
from emvs.rivals.esvo_parameters import Matching

# Variance of a block on a surface of 0..255 below which it is flat.
_FLAT = 1.0

Image = NDArray[np.float32]


def match_blocks(
    left: Image, right: Image, pixels: NDArray[np.int64], range_px: tuple[int, int],
    settings: Matching,
) -> tuple[Image, Image]:  # fmt: skip
    """Matches a block around each pixel.

    Args:
        left: (H, W) float32 time surface, 0..255.
        right: (H, W) float32, rows aligned with it.
        pixels: (N, 2) int64 columns and rows in the left one.
        range_px: smallest and largest disparity.
        settings: of the matching.

    Returns:
        (N,) float32 whole disparities, px, NaN where no block of the right surface reaches
        `least_zncc`, the best lies at either end of the range, or the block leaves the picture;
        and (N,) float32 their ZNCC.
    """
    disparity_px = np.empty(len(pixels), np.float32)
    score = np.empty(len(pixels), np.float32)
    low, high = max(range_px[0] - 1, 0), range_px[1] + 1
    half = settings.width_px // 2, settings.height_px // 2
    _search(
        left, right, pixels, low, high, half[0], half[1], settings.coarse_px, disparity_px, score
    )
    with np.errstate(invalid="ignore"):
        good = (score >= settings.least_zncc) & (disparity_px > low) & (disparity_px < high)
    return np.where(good, disparity_px, np.float32(np.nan)), score


@njit(cache=True)
def _zncc(left, right, u, v, d, half_x, half_y):
    """ZNCC of two blocks, -2 where one is flat or leaves the picture."""
    width = left.shape[1]
    if u - d - half_x < 0 or u - d + half_x >= width:
        return -2.0
    n = (2 * half_x + 1) * (2 * half_y + 1)
    a, b, aa, bb, ab = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(v - half_y, v + half_y + 1):
        for i in range(u - half_x, u + half_x + 1):
            p, q = np.float64(left[j, i]), np.float64(right[j, i - d])
            a += p
            b += q
            aa += p * p
            bb += q * q
            ab += p * q
    aa -= a * a / n
    bb -= b * b / n
    if aa < _FLAT * n or bb < _FLAT * n:
        return -2.0
    return (ab - a * b / n) / np.sqrt(aa * bb)


@njit(cache=True, parallel=True)
def _search(left, right, pixels, low, high, half_x, half_y, coarse, out_px, out_zncc):
    """Fills the best disparity and its ZNCC per pixel: every `coarse`, then around the best."""
    height, width = left.shape
    for k in prange(len(pixels)):
        u, v = pixels[k, 0], pixels[k, 1]
        out_px[k], out_zncc[k] = np.nan, -2.0
        if u < half_x or v < half_y or u >= width - half_x or v >= height - half_y:
            continue
        best, where = -2.0, -1
        for d in range(low, high + 1, coarse):
            value = _zncc(left, right, u, v, d, half_x, half_y)
            if value > best:
                best, where = value, d
        if where < 0:
            continue
        middle = where
        for d in range(max(low, middle - coarse + 1), min(high, middle + coarse - 1) + 1):
            value = _zncc(left, right, u, v, d, half_x, half_y)
            if value > best:
                best, where = value, d
        out_px[k], out_zncc[k] = where, best
