"""Compiled loops that turn render samples into the light of pixel-sized boxes around each of them.

The mean over a box that slides by one sample is what a pixel would see if it sat there: between the
pixels of a picture lies what they see while the picture moves.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)


@numba.njit(cache=True, nogil=True)
def box_mean(samples: NDArray[np.float32], supersample: int, light: NDArray[np.float32]) -> None:
    """Fills `light` with the mean of the S x S samples from each sample on, down and to the right.

    Args:
        samples: (Hs, Ws).
        supersample: S.
        light: out, (Hs - S + 1, Ws - S + 1).
    """
    rows, columns = light.shape
    share = np.float32(1.0 / (supersample * supersample))
    column = np.empty(samples.shape[1], np.float32)
    for i in range(rows):
        for j in range(len(column)):
            column[j] = samples[i, j]
        for q in range(1, supersample):
            column += samples[i + q]
        column *= share
        row = light[i]
        for j in range(columns):
            row[j] = column[j]
        for q in range(1, supersample):
            row += column[q : q + columns]


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def box_nearest(
    window_depth: NDArray[np.float32], supersample: int, nearest: NDArray[np.float32]
) -> None:
    """Fills `nearest` (H, W), top row first, with the largest window depth of each pixel's samples.

    Args:
        window_depth: (S H, S W) window depth of the samples, 1 near and 0 far, bottom row first.
        supersample: S, samples per pixel and axis.
        nearest: out, (H, W).
    """
    height, width = nearest.shape
    row = np.empty(supersample * width, np.float32)
    for i in range(height):
        first = (height - 1 - i) * supersample
        for j in range(len(row)):
            row[j] = window_depth[first, j]
        for q in range(1, supersample):
            for j in range(len(row)):
                row[j] = max(row[j], window_depth[first + q, j])
        for j in range(width):
            near = row[j * supersample]
            for q in range(1, supersample):
                near = max(near, row[j * supersample + q])
            nearest[i, j] = near
