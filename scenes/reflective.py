"""Hard: a kitchen of polished stone, glass, steel and enamel: no surface is quite matt."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.random import default_rng

from eventsweep.scenes.parts import furniture as fu
from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.props import plant
from eventsweep.scenes.parts.stock import faded, made, painted
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.parts.print import plain_carton

    marble = ((0.30, 0.29, 0.28), (0.46, 0.45, 0.43))
    glaze = ((0.50, 0.54, 0.56), (0.62, 0.66, 0.67))
    oak = ((0.34, 0.24, 0.15), (0.62, 0.46, 0.30))
    return made(
        371,
        {
            "stone": lambda rng: tx.tiles((768, 640), rng, 6, marble),
            "wall": painted(0.62, (1, 0.99, 0.95), 0.03),
            "tiles": lambda rng: tx.tiles((256, 256), rng, 6, glaze),
            "wood": lambda rng: tx.wood((128, 512), rng, colours=oak),
            "poster": lambda rng: tx.poster((512, 360), rng, (0.3, 0.34, 0.3), (0.86, 0.6, 0.3)),
            "screen": faded(lambda rng: tx.screen((270, 480), rng), 0.25),
            "pot": lambda rng: tx.solid(96, rng, (0.46, 0.22, 0.14), (0.74, 0.48, 0.34)),
            "leaf": lambda rng: tx.solid(96, rng, (0.12, 0.28, 0.12), (0.42, 0.62, 0.3), bands=4),
            "mug": lambda rng: tx.solid(96, rng, (0.2, 0.3, 0.46), (0.84, 0.82, 0.76), bands=5),
            "carton": faded(lambda rng: plain_carton(192, rng), 0.2),
            "fruit": lambda rng: tx.solid(64, rng, (0.6, 0.42, 0.12), (0.78, 0.6, 0.2), fineness=3),
        },
    )


def _edit(spec: mujoco.MjSpec) -> None:
    _line(spec)
    _on_walls(spec)
    table = fu.BodyBuilder(spec, "table", (-0.55, 1.55, 0), 12)
    table.box((0.55, 0.36, 0.02), (0, 0, 0.74), "wood")
    for x in (-0.48, 0.48):
        for y in (-0.3, 0.3):
            table.rod((x, y, 0), (x, y, 0.72), 0.022, "metal")
    table.drum(0.16, 0.012, (0.05, 0.02, 0.772), "enamel")
    for k, (x, y) in enumerate(((0.0, 0.05), (0.1, 0.0), (0.03, -0.06))):
        table.ball((0.042, 0.042, 0.042), (x, y, 0.825 + 0.004 * k), "fruit", (30 * k, 20, 0))
    table.drum(0.035, 0.11, (-0.3, 0.12, 0.87), "metal")
    table.ball((0.055, 0.055, 0.055), (-0.24, -0.14, 0.815), "enamel")
    table.drum(0.04, 0.05, (0.33, -0.12, 0.81), "mug")
    fu.chair(spec, "chair", (0.55, 2.4, 0), 210)
    fu.chair(spec, "stool", (-1.25, 2.55, 0), 150)
    at = fu.BodyBuilder(spec, "floor_things")
    at.drum(0.15, 0.16, (1.9, 4.2, 0.16), "pot")
    plant(spec, "plant", (1.9, 4.2, 0.3), 0.9, default_rng(372), leaves=10)
    at.box((0.2, 0.16, 0.15), (1.25, 3.4, 0.15), "carton", (0, 0, 24))
    at.ball((0.15, 0.15, 0.15), (0.35, 3.5, 0.15), "enamel")


def _line(spec: mujoco.MjSpec) -> None:
    """Kitchen units along the back wall: steel, lacquer, glazed tiles, pans on a rail."""
    at = BodyBuilder(spec, "units", (0, 5.02, 0))
    for k in range(5):
        x = -2.0 + 0.62 * k
        at.box((0.3, 0.3, 0.4), (x, 0, 0.5), "metal" if k == 2 else "lacquer")
        at.rod((x - 0.18, -0.33, 0.82), (x + 0.18, -0.33, 0.82), 0.009, "metal")
        at.box((0.3, 0.17, 0.32), (x, 0.15, 1.85), "lacquer")
        at.rod((x + 0.24, -0.04, 1.62), (x + 0.24, -0.04, 1.8), 0.008, "metal")
    at.box((1.58, 0.32, 0.02), (-0.76, -0.01, 0.92), "wood")
    at.box((1.58, 0.01, 0.29), (-0.76, 0.315, 1.23), "glaze")
    at.rod((-2.1, 0.27, 1.42), (0.5, 0.27, 1.42), 0.008, "metal")
    for k in range(4):
        at.drum(0.09 - 0.008 * k, 0.03, (-0.2 + 0.19 * k, 0.26, 1.25), "metal", (80, 0, 0))
    at.drum(0.11, 0.09, (-1.2, 0.0, 1.03), "enamel")
    at.ball((0.1, 0.1, 0.09), (-0.75, 0.02, 1.04), "metal")
    at.rod((-0.66, 0.02, 1.06), (-0.56, 0.02, 1.13), 0.012, "metal")
    at.box((0.2, 0.12, 0.15), (-1.75, 0.1, 1.09), "carton", (0, 0, 8))
    at.box((0.36, 0.34, 0.95), (1.35, -0.02, 0.95), "metal")
    at.rod((1.06, -0.4, 0.9), (1.06, -0.4, 1.6), 0.012, "dark")
    at.box((0.11, 0.004, 0.16), (1.45, -0.365, 1.5), "poster")


def _on_walls(spec: mujoco.MjSpec) -> None:
    """A glass cupboard on the right wall, pictures opposite, a lamp over the table.

    The floor is the one mirror: MuJoCo draws the reflections of one surface per scene.
    """
    at = BodyBuilder(spec, "on_walls")
    at.box((0.8, 0.55, 0.012), (2.33, 3.3, 1.45), "glass", (0, -90, 0))
    for y in (2.73, 3.87):
        at.box((0.02, 0.03, 0.83), (2.33, y, 1.45), "wood")
    for z in (0.64, 2.26):
        at.box((0.02, 0.57, 0.03), (2.33, 3.3, z), "wood")
    at.box((0.02, 0.02, 0.8), (2.32, 3.3, 1.45), "wood")
    at.box((0.012, 0.35, 0.5), (-2.34, 3.2, 1.5), "poster")
    at.box((0.012, 0.45, 0.3), (-2.34, 4.2, 1.5), "screen")
    at.box((0.02, 3.2, 0.05), (-2.34, 2.4, 0.05), "skirting")
    at.box((0.02, 3.2, 0.05), (2.34, 2.4, 0.05), "skirting")
    at.rod((0.2, 2.2, 1.95), (0.2, 2.2, 2.6), 0.006, "dark")
    at.ball((0.17, 0.17, 0.1), (0.2, 2.2, 1.9), "enamel")


def _motion(_duration_s: float, seed: int) -> HeadSway:
    rest = look_at((0, -0.15, 1.5), (0.25, 3.2, 0.95))
    return HeadSway.seeded(rest, (0.11, 0.05, 0.05), (1.5, 3.0, 2.0), (1.4, 0.7), seed)


SCENE = Scene(
    name="reflective",
    summary="hard: a kitchen with a polished floor, glass, steel and enamel, 1 to 6 m",
    mjcf=Path(__file__).with_name("kitchen.xml"),
    textures=_textures,
    motion=_motion,
    depth_range_m=(1.0, 6.0),
    edit=_edit,
)
