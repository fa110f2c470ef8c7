"""Masked median filter."""

import numpy as np
from numpy.typing import NDArray

from emvs.depth import median_kernels


def masked_median(
    values: NDArray[np.float32], mask: NDArray[np.bool_], kernel_px: int
) -> NDArray[np.float32]:
    """Replaces masked pixels by the lower median of the masked pixels around them.

    Args:
        values: (H, W) float32.
        mask: (H, W) bool.
        kernel_px: width of the square window, odd; it is cut off at the image's edge.

    Returns:
        (H, W) float32; pixels outside the mask keep their values.
    """
    out = values.copy()
    patch = np.empty((len(values), kernel_px * kernel_px + 1), np.float32)
    median_kernels.masked_median(values, mask, kernel_px // 2, patch, out)
    return out
