"""ESVO's first guess: blocks of the left time surface, searched along the right one's row.

Zhou, Gallego, Shen, TRO 2021, section IV: zero-mean normalised cross-correlation (ZNCC), coarse to
fine, gives the inverse depth from which the refinement starts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.rivals.esvo_kernels import search
from emvs.rivals.esvo_parameters import Matching

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
    search(
        left, right, pixels, low, high, half[0], half[1], settings.coarse_px, disparity_px, score
    )
    with np.errstate(invalid="ignore"):
        good = (score >= settings.least_zncc) & (disparity_px > low) & (disparity_px < high)
    return np.where(good, disparity_px, np.float32(np.nan)), score
