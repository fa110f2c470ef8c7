"""The stock room: surfaces and print that most indoor scenes share, as declared in stock.xml."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator

if TYPE_CHECKING:
    from eventsweep.scenes.textures.noise import Colour, Image

Maker = Callable[[Generator], "Image"]

_BOOKS: tuple[tuple[Colour, Colour], ...] = (
    ((0.16, 0.22, 0.34), (0.84, 0.82, 0.74)),
    ((0.62, 0.58, 0.50), (0.20, 0.18, 0.20)),
    ((0.48, 0.14, 0.16), (0.82, 0.70, 0.40)),
    ((0.80, 0.78, 0.72), (0.22, 0.34, 0.52)),
    ((0.20, 0.34, 0.28), (0.84, 0.80, 0.62)),
    ((0.26, 0.24, 0.26), (0.78, 0.60, 0.32)),
    ((0.70, 0.46, 0.20), (0.22, 0.16, 0.16)),
    ((0.40, 0.50, 0.58), (0.88, 0.86, 0.80)),
)


def painted(tone: float, tint: Colour = (1.0, 0.985, 0.95), spread: float = 0.05) -> Maker:
    """Returns the maker of a painted wall: nearly smooth, as most of a real room is.

    Args:
        tone: mean reflectance, 0 to 1.
        tint: factors of red, green and blue.
        spread: from the mean to the darkest and the brightest grain.
    """
    from eventsweep.scenes import textures as tx

    red, green, blue = tint
    low, high = ((red * t, green * t, blue * t) for t in (tone - spread, tone + spread))
    return lambda rng: tx.plaster((512, 512), rng, (low, high), relief=0.4)


def faded(make: Maker, amount: float) -> Maker:
    """Returns `make` with less contrast: what light, ink and age leave of it."""

    def fade(rng: Generator) -> Image:
        picture = make(rng).astype(np.float32)
        mean = picture.mean(axis=(0, 1))
        return np.asarray(np.rint(picture + amount * (mean - picture)), np.uint8)

    return fade


def stock(seed: int) -> dict[str, Image]:
    """Makes every texture that stock.xml declares, the same for the same `seed`."""
    return made(seed, _makers())


def made(seed: int, makers: dict[str, Maker]) -> dict[str, Image]:
    """Runs `makers`, each with a generator of its own drawn from `seed` and the order."""
    from eventsweep.scenes.textures.noise import streams

    rngs = streams(seed, len(makers))
    return {name: make(rng) for (name, make), rng in zip(makers.items(), rngs, strict=True)}


def _makers() -> dict[str, Maker]:
    """Surfaces, then things, then print, then books: a texture's place decides its generator."""
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.parts.print import plain_carton

    beech = ((0.57, 0.44, 0.30), (0.72, 0.56, 0.39))
    return {
        "wall": painted(0.66),
        "board": painted(0.86, (1, 1, 1), 0.015),
        "beech": faded(lambda rng: tx.wood((512, 1024), rng, colours=beech), 0.35),
        "oak": lambda rng: tx.wood(
            (128, 512), rng, colours=((0.36, 0.25, 0.16), (0.54, 0.39, 0.25))
        ),
        "cloth": lambda rng: tx.cloth((256, 256), rng, ((0.18, 0.24, 0.34), (0.30, 0.37, 0.49))),
        "plastic": painted(0.30, (0.96, 0.98, 1.0), 0.03),
        "white": painted(0.78, (1, 1, 0.98), 0.03),
        "metal": lambda rng: tx.solid(128, rng, (0.44, 0.45, 0.47), (0.6, 0.61, 0.63), fineness=6),
        "dark": lambda rng: tx.solid(128, rng, (0.17, 0.17, 0.18), (0.23, 0.23, 0.24), fineness=4),
        "carton_a": faded(lambda rng: tx.carton(256, rng, (0.2, 0.4, 0.6)), 0.65),
        "carton_b": lambda rng: plain_carton(256, rng),
        "mug": lambda rng: tx.solid(128, rng, (0.3, 0.38, 0.5), (0.76, 0.75, 0.7), bands=4.0),
        "pot": lambda rng: tx.solid(128, rng, (0.46, 0.22, 0.14), (0.74, 0.48, 0.34)),
        "leaf": lambda rng: tx.solid(96, rng, (0.12, 0.28, 0.12), (0.42, 0.62, 0.3), bands=4.0),
        "ball": lambda rng: tx.ball(
            192, rng, ((0.74, 0.3, 0.16), (0.88, 0.86, 0.8), (0.2, 0.36, 0.6)), worn=0.15
        ),
        "can": lambda rng: tx.can(160, rng, (0.2, 0.44, 0.5)),
        "keys": faded(lambda rng: tx.keyboard((260, 820), rng), 0.4),
        "screen": faded(lambda rng: tx.screen((540, 960), rng), 0.4),
        "page_a": faded(lambda rng: tx.page((640, 452), rng, lines=44), 0.4),
        "page_b": faded(lambda rng: tx.page((640, 452), rng, lines=34), 0.4),
        "note": lambda rng: tx.label((192, 192), rng, (0.8, 0.62, 0.2)),
        "poster_a": faded(
            lambda rng: tx.poster((640, 440), rng, (0.2, 0.34, 0.5), (0.86, 0.5, 0.22)), 0.35
        ),
        "poster_b": faded(
            lambda rng: tx.poster((640, 440), rng, (0.36, 0.3, 0.2), (0.75, 0.3, 0.22)), 0.35
        ),
        **{f"book_{k}": faded(partial(_book, colours), 0.4) for k, colours in enumerate(_BOOKS)},
    }


def _book(colours: tuple[Colour, Colour], rng: Generator) -> Image:
    from eventsweep.scenes import textures as tx

    return tx.book(192, rng, *colours)
