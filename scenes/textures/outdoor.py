"""Surfaces under the sky: asphalt, gravel, grass, leaves, bark, roofs, and the sky itself."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.random import Generator

from eventsweep.scenes.textures.cubes import wrap
from eventsweep.scenes.textures.noise import Colour, Field, Image, blend, finish, fractal

_GREEN: tuple[Colour, Colour] = ((0.10, 0.18, 0.06), (0.52, 0.64, 0.28))
_BARK: tuple[Colour, Colour] = ((0.16, 0.12, 0.09), (0.58, 0.5, 0.42))
_CLAY: tuple[Colour, Colour] = ((0.3, 0.14, 0.1), (0.68, 0.38, 0.28))

PALETTE_CELLS = 4
"""A palette of leaves has this many cells along each side."""


def asphalt(shape: tuple[int, int], rng: Generator, tone: float = 0.3) -> Image:
    """Lays seamless asphalt: stones in tar, worn patches and a few cracks.

    Args:
        shape: (H, W) in texels.
        rng: source of stones and cracks.
        tone: mean reflectance; 0.2 is new, 0.4 old and dry.
    """
    stones = fractal(shape, rng, 0.25) - 0.5
    worn = fractal(shape, rng, 1.5) - 0.5
    ridge = np.abs(fractal(shape, rng, 1.3) - 0.5)
    crack = np.clip(1.0 - ridge / 0.006, 0.0, 1.0) * (fractal(shape, rng, 1.4) > 0.62)
    return finish((tone + 0.30 * stones + 0.22 * worn) * (1.0 - 0.5 * crack))


def gravel(shape: tuple[int, int], rng: Generator, colours: tuple[Colour, Colour]) -> Image:
    """Strews a seamless path with pebbles of two sizes between the darkest and brightest colour."""
    tone = np.full(shape, 0.5, np.float32)
    for grain_px, weight in ((1.4, 0.16), (3.2, 0.2)):
        noise = rng.standard_normal(shape, dtype=np.float32)
        pebbles = cv2.GaussianBlur(noise, (0, 0), grain_px, borderType=cv2.BORDER_REFLECT_101)
        tone += weight * np.tanh(1.5 * pebbles / pebbles.std(), dtype=float)
    tone += 0.5 * (fractal(shape, rng, 1.3) - 0.5)
    return finish(blend(np.clip(tone, 0, 1), *colours))


def grass(shape: tuple[int, int], rng: Generator, colours: tuple[Colour, Colour] = _GREEN) -> Image:
    """Grows a seamless lawn: blades, tufts and dry places."""
    blades = fractal(shape, rng, 0.45, stretch=(5.0, 1.0)) - 0.5
    tufts = fractal(shape, rng, 0.9) - 0.5
    dry = np.clip(3.0 * (fractal(shape, rng, 1.5) - 0.56), 0.0, 1.0)
    lawn = blend(np.clip(0.46 + 0.85 * blades + 0.5 * tufts, 0, 1), *colours)
    straw = np.asarray((0.5, 0.44, 0.24), np.float32)
    return finish(lawn * (1 - 0.6 * dry[..., None]) + 0.6 * dry[..., None] * straw)


def leaves(size_px: int, rng: Generator, colours: tuple[Colour, Colour] = _GREEN) -> Image:
    """Paints a palette of leaves, PALETTE_CELLS along each side, with veins and shades.

    A card of `scenes.parts.mesh.cards` shows one cell.
    """
    cell = size_px // PALETTE_CELLS
    down, across = np.mgrid[0:cell, 0:cell].astype(np.float32) / cell - 0.5
    veins = 0.5 + 0.5 * np.cos(2 * np.pi * 6 * (down + np.abs(across)))
    rib = np.clip(1 - np.abs(across) / 0.03, 0, 1)
    rows = []
    for _ in range(PALETTE_CELLS):
        row = []
        for _ in range(PALETTE_CELLS):
            tone = rng.uniform(0.12, 0.85) + 0.12 * (veins - 0.5) + 0.15 * rib
            tone = tone + 0.3 * (fractal((cell, cell), rng, 1.0) - 0.5)
            row.append(blend(np.clip(tone, 0, 1), *colours))
        rows.append(np.concatenate(row, axis=1))
    return finish(np.concatenate(rows))


def hedge(shape: tuple[int, int], rng: Generator, leaf_px: float = 7.0) -> Image:
    """Fills a seamless wall with small leaves: dense green of all shades, dark between them."""
    tone = np.zeros(shape, np.float32)
    count = int(3.2 * shape[0] * shape[1] / leaf_px**2)
    centres = rng.random((count, 2)) * (shape[1], shape[0])
    shade = np.clip(rng.normal(0.5, 0.22, count) * np.linspace(0.5, 1.1, count), 0.04, 1)
    turns, lengths = rng.uniform(0, 180, count), leaf_px * rng.uniform(0.5, 1.1, count)
    for (x, y), value, turn, length in zip(centres, shade, turns, lengths, strict=True):
        axes = (max(1, round(length)), max(1, round(0.5 * length)))
        for shift in _copies(x, y, float(length), shape):
            cv2.ellipse(tone, shift, axes, float(turn), 0, 360, float(value), -1)
    tone += 0.25 * (fractal(shape, rng, 0.9) - 0.5)
    return finish(blend(np.clip(tone, 0, 1), *_GREEN))


def _copies(x: float, y: float, reach: float, shape: tuple[int, int]) -> list[tuple[int, int]]:
    """Where a mark at (x, y) must be drawn so that the picture tiles."""
    xs = [x] + [x + w for w in (-shape[1], shape[1]) if -reach <= x + w <= shape[1] + reach]
    ys = [y] + [y + h for h in (-shape[0], shape[0]) if -reach <= y + h <= shape[0] + reach]
    return [(round(a), round(b)) for a in xs for b in ys]


def bark(size_px: int, rng: Generator) -> Image:
    """Wraps a trunk, a cylinder about z, in furrowed bark: a cube map."""
    side = (size_px, 2 * size_px)
    furrows = np.abs(fractal(side, rng, 0.9, stretch=(6.0, 1.0)) - 0.5) * 2
    tone = 0.25 + 1.0 * furrows + 0.3 * (fractal(side, rng, 0.7) - 0.5)
    skin = finish(blend(np.clip(tone, 0, 1), *_BARK))
    lid = finish(blend(fractal((size_px, size_px), rng), *_BARK))
    return wrap(skin, lid)


def roof_tiles(
    shape: tuple[int, int], rng: Generator, rows: int = 12, colours: tuple[Colour, Colour] = _CLAY
) -> Image:
    """Covers a seamless roof with overlapping tiles, each course shading the one below."""
    down, across = np.indices(shape).astype(np.float32)
    v = down / shape[0] * rows
    course = v.astype(np.int64)
    u = across / shape[1] * rows * 1.5 + 0.5 * (course % 2)
    tile = u.astype(np.int64) % (rows * 2)
    shade = rng.uniform(-0.2, 0.2, (rows, rows * 2)).astype(np.float32)[course % rows, tile]
    bulge = 0.25 * np.sin(np.pi * (u % 1.0))
    lip = np.clip(1.0 - (v % 1.0) / 0.18, 0, 1)
    tone = 0.4 + shade + bulge + 0.4 * (fractal(shape, rng, 0.9) - 0.5) - 0.55 * lip
    return finish(blend(np.clip(tone, 0, 1), *colours))


def sky(size_px: int, rng: Generator, cover: float = 0.45) -> Image:
    """Draws a sky as MuJoCo's skybox: bright at the horizon, with soft clouds.

    Args:
        size_px: side of a face, texels.
        rng: source of the clouds.
        cover: share of the sky with clouds, about.

    Returns:
        (6 N, N, 3) uint8 cube map; seamless, because it is a function of the direction.
    """
    from scipy import ndimage  # kept textures need not wait for it

    x, y, z = _sky_directions(size_px)
    height = np.maximum(z, 0.0)
    # Clouds lie on a layer, so they grow smaller towards the horizon.
    layer = np.stack([x, y]) / (height + 0.25)
    block = rng.random((64, 64), dtype=np.float32)
    tone = np.zeros(x.shape, np.float32)
    for octave in range(5):
        at = layer * 1.6 * 2.0**octave + 7.3 * octave
        value = ndimage.map_coordinates(block, at, order=1, mode="grid-wrap", prefilter=False)
        tone += 0.55**octave * (value - 0.5)
    cloud = np.clip(0.5 + 1.6 * (tone + cover - 0.5), 0, 1) * np.clip(6 * height, 0, 1)
    blue = blend(np.clip(1 - height, 0, 1) ** 3, (0.42, 0.6, 0.86), (0.82, 0.87, 0.92))
    white = np.asarray((0.93, 0.94, 0.95), np.float32)
    return finish(blue + 0.75 * cloud[..., None] * (white - blue))


def _sky_directions(size_px: int) -> Field:
    """World directions (3, 6 N, N), z up, of a skybox's texels."""
    from eventsweep.scenes.textures.cubes import _directions

    across, up, back = _directions(size_px)
    return np.stack([across, -back, up])
