"""Compiled loops that turn render samples into the light of pixel-sized boxes around each of them.

The mean over a box that slides by one sample is what a pixel would see if it sat there: between the
pixels of a picture lies what they see while the picture moves.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)


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
        column[:] = samples[i]
        for q in range(1, supersample):
            column += samples[i + q]
        column *= share
        row = light[i]
        row[:] = column[:columns]
        for q in range(1, supersample):
            row += column[q : q + columns]


@numba.njit(cache=True, nogil=True)
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
        row[:] = window_depth[first]
        for q in range(1, supersample):
            row[:] = np.maximum(row, window_depth[first + q])
        for j in range(width):
            near = row[j * supersample]
            for q in range(1, supersample):
                near = max(near, row[j * supersample + q])
            nearest[i, j] = near


@numba.njit(cache=True, nogil=True)
def resampled(
    luma: NDArray[np.float32],
    window_depth: NDArray[np.float32],
    position: NDArray[np.float32],
    step: NDArray[np.float32],
    supersample: int,
    samples: NDArray[np.float32],
    nearest: NDArray[np.float32],
) -> None:
    """Fills the samples of a sensor behind a lens, bilinear, and each pixel's nearest depth.

    Args:
        luma: (Hs, Ws) light of the source picture, bottom row first.
        window_depth: (Hs, Ws) its window depth, 1 near and 0 far.
        position: `LensMap.position`.
        step: `LensMap.step`.
        supersample: S, samples per pixel and axis.
        samples: out, (S H, S W), top row first.
        nearest: out, (H, W), largest window depth of all source samples that took part.
    """
    height, width = nearest.shape
    one = np.uint64(1)
    for v in range(height):
        for u in range(width):
            near = np.float32(0.0)
            for k in range(supersample):
                dv = np.float32((k + 0.5) / supersample - 0.5)
                for m in range(supersample):
                    du = np.float32((m + 0.5) / supersample - 0.5)
                    x = position[v, u, 0] + step[v, u, 0, 0] * du + step[v, u, 0, 1] * dv
                    y = position[v, u, 1] + step[v, u, 1, 0] * du + step[v, u, 1, 1] * dv
                    # Without a sign there is no negative index to look for.
                    j, i = np.uint64(x), np.uint64(y)
                    a, b = x - np.float32(j), y - np.float32(i)
                    below = luma[i, j] + a * (luma[i, j + one] - luma[i, j])
                    above = luma[i + one, j] + a * (luma[i + one, j + one] - luma[i + one, j])
                    samples[v * supersample + k, u * supersample + m] = below + b * (above - below)
                    near = max(near, window_depth[i, j], window_depth[i, j + one])
                    near = max(near, window_depth[i + one, j], window_depth[i + one, j + one])
            nearest[v, u] = near
