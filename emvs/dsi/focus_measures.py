"""Focus measures: how sharply rays meet around a pixel of one plane of a volume.

Where rays of one edge meet, their votes are concentrated; on every other plane the same votes are
smeared over more pixels. A measure of concentration over a small window finds the plane wherever
in the window the edge lies, while the plain maximum along a pixel's own ray follows the slant of
the ray bundle. Every measure looks at one plane only, so volumes can pass plane by plane.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Float32s = NDArray[np.float32]

DOG_RATIO = 1.6  # of the two scales: closest to the Laplacian of a Gaussian (Marr, Hildreth 1980)


def half_window(sigma_px: float) -> Float32s:
    """Weights of a Gaussian at 0, 1, 2, ... px, out to four `sigma_px`; mirrored, they sum to 1."""
    weight = np.exp(-0.5 * (np.arange(round(4 * sigma_px) + 1) / sigma_px) ** 2)
    weight /= weight[0] + 2 * weight[1:].sum()
    return np.asarray(weight, np.float32)


def blurred(plane: Float32s, sigma_px: float) -> Float32s:
    """The Gaussian-weighted mean around each pixel; the image is mirrored at its rim."""
    width = 2 * round(4 * sigma_px) + 1
    return np.asarray(cv2.GaussianBlur(plane, (width, width), sigma_px), np.float32)


def variance(plane: Float32s, sigma_px: float) -> Float32s:
    """The Gaussian-weighted variance of the votes around each pixel."""
    mean = blurred(plane, sigma_px)
    return np.maximum(blurred(plane * plane, sigma_px) - mean * mean, np.float32(0))


def gradient(plane: Float32s, sigma_px: float) -> Float32s:
    """The Gaussian-weighted mean of the squared gradient's length (Sobel) around each pixel."""
    across = cv2.Sobel(plane, cv2.CV_32F, 1, 0, scale=1 / 8)
    down = cv2.Sobel(plane, cv2.CV_32F, 0, 1, scale=1 / 8)
    return blurred(np.asarray(across * across + down * down, np.float32), sigma_px)


def laplacian(plane: Float32s, sigma_px: float) -> Float32s:
    """The Gaussian-weighted mean of the squared Laplacian (four neighbours) around each pixel."""
    bend = cv2.Laplacian(plane, cv2.CV_32F, ksize=1)
    return blurred(np.asarray(bend * bend, np.float32), sigma_px)


FocusMeasure = Callable[[Float32s, float], Float32s]

MEASURES: dict[str, FocusMeasure] = {
    "votes": lambda plane, _sigma_px: plane,  # the ray maximum of the method's paper
    "variance": variance,
    "mean-square": lambda plane, sigma_px: blurred(plane * plane, sigma_px),
    "gradient": gradient,
    "laplacian": laplacian,
    # Negative in the valleys
    "dog": lambda plane, sigma_px: blurred(plane, sigma_px) - blurred(plane, DOG_RATIO * sigma_px),
}
