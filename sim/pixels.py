"""Render samples to pixels: box average of colour, nearest depth."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

# Rec. 709 luma of linear RGB; the last bit makes white exactly 1.
LUMA = (0.2126, 0.7152, 0.0722)


@numba.njit(cache=True, nogil=True)
def average(
    rgb: NDArray[np.uint8] | NDArray[np.float32],
    window_depth: NDArray[np.float32],
    supersample: int,
    intensity: NDArray[np.float32],
    nearest: NDArray[np.float32],
    full_scale: float = 255.0,
) -> None:
    """Fills `intensity` and `nearest` (H, W), top row first, from samples, bottom row first.

    Args:
        rgb: (sH, sW, 3) colour of the samples.
        window_depth: (sH, sW) window depth of the samples, 1 near and 0 far.
        supersample: s, samples per pixel and axis.
        intensity: out, (H, W), mean luma, 1 at full scale.
        nearest: out, (H, W), largest window depth.
        full_scale: the colour value that means 1.
    """
    height, width = intensity.shape
    scale = 1.0 / (full_scale * supersample * supersample)
    for row in range(height):
        first = (height - 1 - row) * supersample
        for column in range(width):
            red = 0
            green = 0
            blue = 0
            near = np.float32(0.0)
            for i in range(first, first + supersample):
                for j in range(column * supersample, (column + 1) * supersample):
                    red += rgb[i, j, 0]
                    green += rgb[i, j, 1]
                    blue += rgb[i, j, 2]
                    near = max(near, window_depth[i, j])
            luma = LUMA[0] * red + LUMA[1] * green + LUMA[2] * blue
            intensity[row, column] = luma * scale
            nearest[row, column] = near


@numba.njit(cache=True, nogil=True)
def luma(
    rgb: NDArray[np.uint8] | NDArray[np.float32], full_scale: float, out: NDArray[np.float32]
) -> None:
    """Fills `out` (H, W) with the luma of `rgb` (H, W, 3), 1 at `full_scale`."""
    red, green, blue = LUMA[0] / full_scale, LUMA[1] / full_scale, LUMA[2] / full_scale
    height, width = out.shape
    for i in range(height):
        for j in range(width):
            out[i, j] = red * rgb[i, j, 0] + green * rgb[i, j, 1] + blue * rgb[i, j, 2]


def metric_depth(
    window_depth: NDArray[np.float32], near_m: float, far_m: float
) -> NDArray[np.float32]:
    """Turns window depth (1 at the near plane, 0 at the far plane) into z-depth, m; inf at 0."""
    reciprocal = (window_depth.astype(np.float64) * (far_m - near_m) + near_m) / (near_m * far_m)
    return np.where(window_depth > 0, 1 / reciprocal, np.inf).astype(np.float32)
