"""Cube maps: pictures that fold around boxes, cylinders and balls.

MuJoCo looks a cube map up by the direction from a geom's middle, after scaling the geom to a unit
cube, unit cylinder or unit ball; six square faces lie on top of each other.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.random import Generator

from eventsweep.scenes.textures.noise import Colour, Field, Image, blend, finish


def cube(front: Image, right: Image, back: Image, left: Image, top: Image, bottom: Image) -> Image:
    """Stacks six square pictures, each as seen from outside, into MuJoCo's cube map.

    The front looks to -y, right to +x, z is up; the top is seen from above with +y up. The turns
    undo those of OpenGL's cube map faces (+x, -x, +y, -y, +z, -z).

    Returns:
        (6 N, N, 3) uint8 for faces of (N, N, 3).
    """
    faces = (np.rot90(right), np.rot90(left, -1), np.rot90(back, 2), front, top, bottom)
    return np.concatenate(faces)


def wrap(side: Image, lid: Image) -> Image:
    """Wraps a cylinder: `side` once around it, seam at the back, and `lid` on both ends.

    Args:
        side: (H, W, 3) unrolled; its middle faces -y.
        lid: (N, N, 3) square; N becomes the side of the cube map's faces.

    Returns:
        (6 N, N, 3) uint8 cube map, exact for a cylinder about z whatever its proportions.
    """
    height, width = side.shape[:2]
    x, y, z = _directions(len(lid))
    radius = np.hypot(x, y)
    around = (np.arctan2(x, -y, dtype=float) / (2 * np.pi) + 0.5).astype(np.float32)
    rise = np.clip(0.5 - 0.5 * z / np.maximum(radius, 1e-6), 0.0, 1.0)
    seen = cv2.remap(side, around * (width - 1), rise * (height - 1), cv2.INTER_LINEAR)
    return np.where((np.abs(z) > radius)[..., None], np.tile(lid, (6, 1, 1)), seen)


def solid(
    size_px: int,
    rng: Generator,
    low: Colour,
    high: Colour,
    bands: float = 0.0,
    fineness: float = 1.0,
) -> Image:
    """Carves a cube map out of a block of noise, so that a ball or a pot shows no seam.

    Args:
        size_px: side of a face, texels.
        rng: source of the noise.
        low: darkest colour.
        high: brightest colour.
        bands: 0 for stone, more for veins: how many the block has.
        fineness: 1 for clouds as large as the object, 8 for the grain of cast metal.

    Returns:
        (6 N, N, 3) uint8 cube map.
    """
    from scipy import ndimage  # kept textures need not wait for it

    points = _directions(size_px)
    block = rng.random((64, 64, 64), dtype=np.float32)
    tone = np.zeros(points.shape[1:], np.float32)
    for octave in range(5):
        at = points * fineness * 2.0 ** (octave + 1) + 5.0 * octave
        tone += 0.65**octave * (
            ndimage.map_coordinates(block, at, order=1, mode="grid-wrap", prefilter=False) - 0.5
        )
    if bands:
        tone = np.sin(bands * (points[2] * 2 + 0.9 * tone)).astype(np.float32) * 0.35 + 0.5 * tone
    return finish(blend(np.clip(0.5 + 0.85 * tone, 0, 1), low, high))


def ball(size_px: int, rng: Generator, colours: Sequence[Colour], worn: float = 0.5) -> Image:
    """Paints a beach ball as a cube map: sectors about z, caps at the poles, scuffs all over.

    Args:
        size_px: side of a face, texels.
        rng: source of the scuffs.
        colours: of the sectors, in turn.
        worn: strength of the scuffs.
    """
    x, y, z = _directions(size_px)
    turn = np.arctan2(y, x, dtype=float) / (2 * np.pi) + 0.5
    sector = np.floor(turn * 2 * len(colours)).astype(np.int64)
    sector[np.abs(z) > 0.93] = 1
    paint = np.asarray(colours, np.float32)[sector % len(colours)]
    scuffs = solid(size_px, rng, (0, 0, 0), (1, 1, 1), fineness=3.0).astype(np.float32) / 255.0
    return finish(np.asarray(paint * (1.0 + worn * (scuffs - 0.5))))


def _directions(size_px: int) -> Field:
    """Unit vectors (3, 6 N, N) from the middle of a cube to the texels of its map."""
    axis = np.linspace(-1, 1, size_px, dtype=np.float32)
    down, across = np.meshgrid(axis, axis, indexing="ij")
    one = np.ones_like(down)
    faces = [(one, -down, -across), (-one, -down, across), (across, one, down)]
    faces += [(across, -one, -down), (across, -down, one), (-across, -down, -one)]
    points = np.concatenate([np.stack(face) for face in faces], axis=1)
    return np.asarray(points / np.linalg.norm(points, axis=0), np.float32)
