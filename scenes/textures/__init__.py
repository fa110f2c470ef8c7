"""Procedural textures: seeded, seamless where they tile, and rich at every scale.

Every function takes its size in texels and a `numpy.random.Generator`, and returns (H, W, 3)
uint8 within [DARKEST, BRIGHTEST]; cube maps are six square faces on top of each other.
"""

from eventsweep.scenes.textures.cubes import ball, cube, solid, wrap
from eventsweep.scenes.textures.noise import (
    BRIGHTEST,
    DARKEST,
    Colour,
    Image,
    blend,
    dead_leaves,
    finish,
    fractal,
    streams,
)
from eventsweep.scenes.textures.objects import book, can, carton, crate, drum, keyboard, toy_block
from eventsweep.scenes.textures.printing import label, page, poster, screen
from eventsweep.scenes.textures.surfaces import bricks, cardboard, cloth, cork, plaster, tiles, wood

__all__ = [
    "BRIGHTEST",
    "DARKEST",
    "Colour",
    "Image",
    "ball",
    "blend",
    "book",
    "bricks",
    "can",
    "cardboard",
    "carton",
    "cloth",
    "cork",
    "crate",
    "cube",
    "dead_leaves",
    "drum",
    "finish",
    "fractal",
    "keyboard",
    "label",
    "page",
    "plaster",
    "poster",
    "screen",
    "solid",
    "streams",
    "tiles",
    "toy_block",
    "wood",
    "wrap",
]
