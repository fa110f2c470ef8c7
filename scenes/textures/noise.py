"""Noise with detail at every scale, and the step from reflectance to 8 bits."""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Image: TypeAlias = NDArray[np.uint8]  # (H, W, 3) RGB
Field: TypeAlias = NDArray[np.float32]  # (H, W) or (H, W, 3), 0..1
Colour: TypeAlias = tuple[float, float, float]  # RGB, 0..1

DARKEST, BRIGHTEST = 28, 232
"""The intensity bounds of every texture: the sensor sees logarithms, so nothing is black."""


def streams(seed: int, count: int) -> list[Generator]:
    """Returns one generator per texture, so that a change to one leaves the others alone."""
    return [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(count)]


def finish(reflectance: NDArray[np.floating]) -> Image:
    """Maps reflectance 0..1 onto the intensity bounds of a texture.

    Args:
        reflectance: (H, W) or (H, W, 3), values outside 0..1 are clipped.

    Returns:
        (H, W, 3) uint8 within [DARKEST, BRIGHTEST].
    """
    rgb = reflectance if reflectance.ndim == 3 else np.repeat(reflectance[..., None], 3, axis=2)
    scaled = np.clip(rgb, 0.0, 1.0) * (BRIGHTEST - DARKEST) + DARKEST
    pixels: Image = np.rint(scaled).astype(np.uint8)
    return pixels


def fractal(
    shape: tuple[int, int],
    rng: Generator,
    slope: float = 1.1,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> Field:
    """Draws seamless noise whose amplitude falls as 1 / frequency**slope.

    Args:
        shape: (H, W) in texels.
        rng: source of the phases.
        slope: 1 is as rough as natural pictures, 2 is smooth clouds, 0 is white.
        stretch: features are this many times longer along (rows, columns).

    Returns:
        (H, W) float32 within 0..1, mean near 0.5, standard deviation near 0.18.
    """
    from scipy import fft  # kept textures need not wait for it

    height, width = shape
    spectrum = fft.rfft2(rng.standard_normal(shape, dtype=np.float32))
    rows = fft.fftfreq(height)[:, None].astype(np.float32) * (height * stretch[0])
    columns = fft.rfftfreq(width)[None, :].astype(np.float32) * (height * stretch[1])
    frequency_squared = rows**2 + columns**2
    # From doubles, as exp, tanh and arctan2 are elsewhere: NumPy's for float32 differ by processor.
    power = np.maximum(frequency_squared, 0.25).astype(float) ** (-0.5 * slope)
    gain = power.astype(np.float32)
    gain[frequency_squared < 1.0] = 0.0
    field = fft.irfft2(spectrum * gain, s=shape)
    return _field(np.clip(0.5 + 0.18 * field / field.std(), 0.0, 1.0))


def blend(amount: NDArray[np.floating], low: Colour, high: Colour) -> Field:
    """Colours a field: 0 becomes `low`, 1 becomes `high`.

    Returns:
        (H, W, 3) float32.
    """
    a, b = np.asarray(low, np.float32), np.asarray(high, np.float32)
    return _field(a + amount[..., None] * (b - a))


def dead_leaves(
    shape: tuple[int, int], rng: Generator, colours: int = 0, leaves: int = 8000
) -> Field:
    """Covers a picture with opaque discs and polygons of all sizes: the statistics of clutter.

    Sizes are drawn from a density ~ r**-3, which makes the picture look alike at every zoom.

    Args:
        shape: (H, W) in texels.
        rng: source of places, sizes and shades.
        colours: 0 for greys, otherwise how strongly (percent) leaves are tinted.
        leaves: how many fall, the last on top.

    Returns:
        (H, W, 3) float32 within 0..1.
    """
    height, width = shape
    canvas = np.full((height, width, 3), 128, np.uint8)
    smallest, largest = 4.0, 0.3 * height
    quantile = rng.random(leaves)
    radii = (smallest**-2 + quantile * (largest**-2 - smallest**-2)) ** -0.5
    centres = rng.random((leaves, 2)) * (width, height)
    grey = rng.uniform(30, 225, (leaves, 1))
    shades = grey + rng.uniform(-1, 1, (leaves, 3)) * colours
    for centre, radius, shade in zip(centres, radii, np.clip(shades, 8, 247), strict=True):
        _leaf(canvas, centre, float(radius), shade, rng)
    return canvas.astype(np.float32) / 255.0


def _field(values: NDArray[np.floating]) -> Field:
    return values.astype(np.float32, copy=False)


def _leaf(
    canvas: Image,
    centre: NDArray[np.float64],
    radius: float,
    shade: NDArray[np.float64],
    rng: Generator,
) -> None:
    corners = int(rng.integers(3, 9))
    turn = rng.uniform(0, 2 * np.pi)
    angles = turn + np.arange(corners) * 2 * np.pi / corners
    points = centre + radius * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    colour = tuple(float(channel) for channel in shade)
    if corners > 6:
        cv2.circle(canvas, (int(centre[0]), int(centre[1])), int(radius), colour, -1, cv2.LINE_AA)
    else:
        cv2.fillPoly(canvas, [points.astype(np.int32)], colour, cv2.LINE_AA)
