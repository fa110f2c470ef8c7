"""Render samples to pixels: box average of colour, nearest depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def metric_depth(
    window_depth: NDArray[np.float32], near_m: float, far_m: float
) -> NDArray[np.float32]:
    """Turns window depth (1 at the near plane, 0 at the far plane) into z-depth, m; inf at 0."""
    reciprocal = (window_depth.astype(np.float64) * (far_m - near_m) + near_m) / (near_m * far_m)
    return np.where(window_depth > 0, 1 / reciprocal, np.inf).astype(np.float32)
