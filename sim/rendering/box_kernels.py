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
def inverse_depth(samples: NDArray[np.float32], near_m: float, far_m: float) -> None:
    """Turns window depth, 1 at the near plane and 0 at the far one, into inverse depth, in place.

    Args:
        samples: in and out, (Hs, Ws); 0 stays 0, for no surface.
        near_m: where the near plane lies.
        far_m: where the far plane lies.
    """
    scale, least = np.float32(1 / near_m - 1 / far_m), np.float32(1 / far_m)
    for i in range(len(samples)):
        row = samples[i]
        for j in range(len(row)):
            row[j] = row[j] * scale + least if row[j] > 0 else np.float32(0)


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def inverse_depth_in_lens(
    samples: NDArray[np.float32],
    supersample: int,
    ratio: NDArray[np.float32],
    near_m: float,
    far_m: float,
) -> None:
    """The same for window depths of sub-views: inverse z-depth in the lens's axes, in place.

    Args:
        samples: in and out, (S H, S W).
        supersample: S, samples per pixel and axis.
        ratio: (H, W, 3) of `sim.rendering.sub_views.LensMap`.
        near_m: where the near plane of all sub-views lies.
        far_m: where their far plane lies.
    """
    scale, least = np.float32(1 / near_m - 1 / far_m), np.float32(1 / far_m)
    one, none = np.float32(1), np.float32(0)
    offset = np.empty(supersample, np.float32)
    for k in range(supersample):
        offset[k] = (k + 0.5) / supersample - 0.5
    for v in range(ratio.shape[0]):
        for k in range(supersample):
            row = samples[supersample * v + k]
            for u in range(ratio.shape[1]):
                middle = ratio[v, u, 0] + offset[k] * ratio[v, u, 2]
                for m in range(supersample):
                    x = supersample * u + m
                    rho = (row[x] * scale + least) * (one / (middle + offset[m] * ratio[v, u, 1]))
                    row[x] = rho if row[x] > none else none


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def nearest_of_pixels(
    inverse_depth_per_m: NDArray[np.float32],
    supersample: int,
    border: int,
    depth_m: NDArray[np.float32],
) -> None:
    """Fills `depth_m` (H, W) with the least depth of each pixel's samples; inf without a surface.

    Args:
        inverse_depth_per_m: (S (H + 2 B), S (W + 2 B)).
        supersample: S, samples per pixel and axis.
        border: B, pixels around the sensor.
        depth_m: out.
    """
    height, width = depth_m.shape
    row = np.empty(inverse_depth_per_m.shape[1], np.float32)
    for i in range(height):
        first = supersample * (i + border)
        for j in range(len(row)):
            row[j] = inverse_depth_per_m[first, j]
        for q in range(first + 1, first + supersample):
            for j in range(len(row)):
                row[j] = max(row[j], inverse_depth_per_m[q, j])
        for j in range(width):
            near = np.float32(0)
            for m in range(supersample * (j + border), supersample * (j + border + 1)):
                near = max(near, row[m])
            depth_m[i, j] = np.float32(1) / near if near > 0 else np.float32(np.inf)


@numba.njit(cache=True, nogil=True)
def pixel_means(
    light: NDArray[np.float32], supersample: int, border: int, intensity: NDArray[np.float32]
) -> None:
    """Fills `intensity` (H, W) with the mean light of each pixel's samples.

    Args:
        light: (S (H + 2 B), S (W + 2 B)).
        supersample: S, samples per pixel and axis.
        border: B, pixels around the sensor.
        intensity: out.
    """
    height, width = intensity.shape
    share = np.float32(1.0 / (supersample * supersample))
    for i in range(height):
        for j in range(width):
            total = np.float32(0)
            for q in range(supersample * (i + border), supersample * (i + border + 1)):
                for m in range(supersample * (j + border), supersample * (j + border + 1)):
                    total += light[q, m]
            intensity[i, j] = total * share
