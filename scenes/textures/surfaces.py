"""Surfaces of rooms and furniture: wood, brick, tiles, cork, cloth, plaster, cardboard."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.random import Generator

from eventsweep.scenes.textures.noise import Colour, Field, Image, blend, finish, fractal

_OAK: tuple[Colour, Colour] = ((0.22, 0.13, 0.07), (0.72, 0.52, 0.33))
_CLAY: tuple[Colour, Colour] = ((0.34, 0.14, 0.1), (0.72, 0.42, 0.32))


def _grid(shape: tuple[int, int]) -> tuple[Field, Field]:
    """Row and column of every texel, 0..1."""
    rows, columns = np.indices(shape).astype(np.float32)
    return rows / np.float32(shape[0]), columns / np.float32(shape[1])


def _grain(shape: tuple[int, int], rng: Generator) -> Field:
    rows, _ = _grid(shape)
    warp = fractal(shape, rng, 1.8, stretch=(1.0, 9.0))
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (9.0 * rows + 7.0 * warp))
    fibre = fractal(shape, rng, 0.7, stretch=(1.0, 22.0))
    pores = np.clip((fractal(shape, rng, 0.3, stretch=(1.0, 14.0)) - 0.72) * 6.0, 0.0, 1.0)
    stain = fractal(shape, rng, 1.5)
    mix = 0.5 + 0.3 * (rings - 0.5) + 0.75 * (fibre - 0.5) + 0.5 * (stain - 0.5) - 0.5 * pores
    return np.asarray(np.clip(mix, 0, 1), np.float32)


def wood(
    shape: tuple[int, int],
    rng: Generator,
    planks: int = 1,
    colours: tuple[Colour, Colour] = _OAK,
) -> Image:
    """Grows wood with its grain along the columns, in `planks` boards with joints.

    Args:
        shape: (H, W) in texels.
        rng: source of rings, fibres and pores.
        planks: boards across the height; each has its own shade and butt joints.
        colours: of the darkest and the brightest wood.
    """
    grain = _grain(shape, rng)
    if planks > 1:
        grain = _boards(grain, rng, planks)
    return finish(blend(np.clip(grain, 0, 1), *colours))


def _boards(grain: Field, rng: Generator, planks: int) -> Field:
    height, width = grain.shape
    rows, columns = _grid((height, width))
    board = np.minimum((rows * planks).astype(np.int64), planks - 1)
    along = (columns + rng.random(planks).astype(np.float32)[board]) * 2
    piece = board * 7 + along.astype(np.int64)
    shade = rng.uniform(-0.17, 0.17, 7 * planks + 7).astype(np.float32)[piece]
    joint_px = np.minimum(_to_edge(rows * planks) * height / planks, _to_edge(along) * width / 2)
    return np.asarray((grain + shade) * np.clip(0.25 + 0.4 * joint_px, 0, 1), np.float32)


def _to_edge(cell: Field) -> Field:
    part = cell % 1.0
    return np.asarray(np.minimum(part, 1.0 - part), np.float32)


def bricks(
    shape: tuple[int, int],
    rng: Generator,
    courses: int = 12,
    per_course: int = 5,
    colours: tuple[Colour, Colour] = _CLAY,
    mortar: Colour = (0.7, 0.68, 0.63),
) -> Image:
    """Lays a seamless wall of bricks in running bond, each with its own shade and chipped edges.

    Args:
        shape: (H, W) in texels.
        rng: source of shades and roughness.
        courses: rows of bricks; must be even to tile.
        per_course: bricks in a row.
        colours: of the darkest and the brightest brick.
        mortar: colour of the joints.
    """
    rows, columns = _grid(shape)
    chip = fractal(shape, rng, 1.2) - 0.5
    v = (rows + 0.004 * chip) * courses
    course = np.floor(v).astype(np.int64)
    u = (columns + 0.004 * chip) * per_course + 0.5 * (course % 2)
    brick = np.floor(u).astype(np.int64) % per_course
    shade = rng.uniform(-0.3, 0.3, (courses, per_course)).astype(np.float32)
    tone = 0.5 + shade[course % courses, brick] + 0.75 * (fractal(shape, rng, 0.85) - 0.5)
    edge = np.minimum(_to_edge(v) / courses * shape[0], _to_edge(u) / per_course * shape[1])
    joint = 0.055 * shape[0] / courses
    solid = np.clip((edge - joint) / (0.35 * joint) + 2.0 * chip, 0.0, 1.0)[..., None]
    wall = blend(np.clip(tone, 0, 1), *colours)
    gap = np.asarray(mortar, np.float32) * (0.7 + 0.6 * fractal(shape, rng, 0.6))[..., None]
    return finish(wall * solid + gap * (1.0 - solid))


def tiles(
    shape: tuple[int, int], rng: Generator, count: int = 6, colours: tuple[Colour, Colour] = _OAK
) -> Image:
    """Lays a seamless floor of count × count speckled tiles with dark joints."""
    rows, columns = _grid(shape)
    v, u = rows * count, columns * count
    shade = rng.uniform(-0.22, 0.22, (count, count)).astype(np.float32)
    shade = shade[v.astype(np.int64) % count, u.astype(np.int64) % count]
    tone = 0.55 + shade + 0.9 * (fractal(shape, rng, 0.75) - 0.5)
    joint_px = np.minimum(_to_edge(v), _to_edge(u)) * shape[0] / count
    return finish(
        blend(np.clip(tone, 0, 1), *colours) * np.clip(0.45 * joint_px, 0.4, 1)[..., None]
    )


def cork(shape: tuple[int, int], rng: Generator) -> Image:
    """Presses a cork board out of grains of three sizes."""
    tone = np.zeros(shape, np.float32)
    for grain_px, weight in ((3.0, 0.3), (7.0, 0.4), (15.0, 0.3)):
        blurred = cv2.GaussianBlur(rng.standard_normal(shape, dtype=np.float32), (0, 0), grain_px)
        tone += weight * np.tanh(1.6 * blurred / blurred.std(), dtype=float)
    tone = 0.5 + 0.4 * tone + 0.35 * (fractal(shape, rng, 0.5) - 0.5)
    return finish(blend(np.clip(tone, 0, 1), (0.28, 0.17, 0.09), (0.78, 0.6, 0.4)))


def cloth(
    shape: tuple[int, int], rng: Generator, colours: tuple[Colour, Colour], threads: int = 128
) -> Image:
    """Weaves a plain cloth of uneven threads, seamless."""
    rows, columns = _grid(shape)
    over = np.sin(np.pi * threads * rows) * np.sin(np.pi * threads * columns)
    uneven = fractal(shape, rng, 0.6, (1.0, 12.0)) + fractal(shape, rng, 0.6, (12.0, 1.0)) - 1.0
    tone = 0.5 + 0.18 * over + 0.7 * uneven + 0.6 * (fractal(shape, rng, 1.2) - 0.5)
    return finish(blend(np.clip(tone, 0, 1), *colours))


def plaster(
    shape: tuple[int, int], rng: Generator, colours: tuple[Colour, Colour], relief: float = 1.0
) -> Image:
    """Trowels a rough wall: grain as if lit from the upper left, and old patches."""
    bumps = fractal(shape, rng, 1.15)
    lit = bumps - np.roll(bumps, (2, 2), (0, 1))
    tone = 0.5 + relief * 0.18 * lit / lit.std() + 0.8 * (fractal(shape, rng, 1.1) - 0.5)
    return finish(blend(np.clip(tone, 0, 1), *colours))


def cardboard(shape: tuple[int, int], rng: Generator) -> Field:
    """Makes brown cardboard with faint flutes and scuffs, as reflectance to print on."""
    flutes = fractal(shape, rng, 0.5, stretch=(14.0, 1.0))
    tone = 0.25 + 0.35 * flutes + 0.4 * fractal(shape, rng, 0.9)
    return blend(np.clip(tone, 0, 1), (0.36, 0.24, 0.14), (0.76, 0.58, 0.4))
