"""Hard: a freshly painted room in which little but edges says where things are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.shadows import bake
from eventsweep.scenes.parts.stock import made, painted
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx

    grey = ((0.50, 0.50, 0.49), (0.53, 0.53, 0.52))
    return made(
        341,
        {
            "wall": painted(0.76, (1, 0.99, 0.97), 0.008),
            "floor": lambda rng: tx.plaster((640, 500), rng, grey, relief=0.4),
            "ceiling": painted(0.86, (1, 1, 1), 0.006),
            "door": painted(0.84, (1, 1, 0.99), 0.006),
            "board": painted(0.9, (1, 1, 1), 0.004),
            "white_wood": lambda rng: tx.solid(96, rng, (0.8, 0.8, 0.79), (0.83, 0.83, 0.82)),
            "sofa": lambda rng: tx.solid(96, rng, (0.44, 0.47, 0.5), (0.47, 0.5, 0.53)),
        },
    )


def _edit(spec: mujoco.MjSpec) -> None:
    at = BodyBuilder(spec, "room")
    for x in (-2.14, 2.14):
        at.box((0.012, 3.2, 0.04), (x, 2.2, 0.04), "white_wood")
    at.box((2.5, 0.012, 0.04), (0, 4.94, 0.04), "white_wood")
    at.box((0.5, 0.02, 1.08), (-1.3, 4.95, 1.08), "frame")
    at.box((0.44, 0.012, 1.03), (-1.3, 4.92, 1.03), "door")
    at.rod((-0.99, 4.88, 1.02), (-1.11, 4.88, 1.02), 0.011, "metal")
    at.box((0.04, 0.006, 0.04), (-0.62, 4.945, 1.1), "switch")
    at.box((0.55, 0.02, 0.4), (0.75, 4.945, 1.6), "board")
    at.box((0.024, 0.75, 0.6), (2.15, 3.0, 1.55), "frame")
    at.box((0.012, 0.7, 0.55), (2.13, 3.0, 1.55), "glass")
    at.box((0.02, 0.02, 0.6), (2.115, 3.0, 1.55), "frame")
    sofa = BodyBuilder(spec, "sofa", (0.95, 3.9, 0), -8)
    sofa.box((0.8, 0.4, 0.2), (0, 0, 0.2), "sofa")
    sofa.box((0.8, 0.1, 0.25), (0, 0.34, 0.55), "sofa")
    for x in (-0.72, 0.72):
        sofa.box((0.1, 0.4, 0.12), (x, 0, 0.5), "sofa")
    things = BodyBuilder(spec, "things")
    things.box((0.3, 0.3, 0.3), (-0.85, 2.9, 0.3), "white_wood", (0, 0, 28))
    things.ball((0.16, 0.16, 0.16), (-0.85, 2.9, 0.76), "white_wood")
    things.drum(0.2, 0.36, (0.35, 2.2, 0.36), "white_wood")
    things.drum(0.26, 0.012, (0.35, 2.2, 0.73), "white_wood")
    things.drum(0.14, 0.012, (-1.75, 3.7, 0.012), "dark")
    things.rod((-1.75, 3.7, 0), (-1.75, 3.7, 1.5), 0.012, "dark")
    things.drum(0.17, 0.13, (-1.75, 3.7, 1.6), "board")
    things.box((0.4, 0.24, 0.015), (-0.42, 0.88, 0.92), "white_wood", (0, 0, 10))
    things.box((0.03, 0.03, 0.45), (-0.12, 1.05, 0.45), "white_wood", (0, 0, 10))
    things.drum(0.045, 0.05, (-0.3, 0.92, 0.985), "switch")
    things.box((0.105, 0.15, 0.0008), (-0.58, 0.86, 0.936), "board", (0, 0, 32))
    bake(spec, floor="floor")


def _motion(_duration_s: float, seed: int) -> HeadSway:
    rest = look_at((0, -0.2, 1.4), (0.1, 3.2, 0.85))
    return HeadSway.seeded(rest, (0.10, 0.05, 0.05), (1.5, 3.0, 2.0), (1.4, 0.7), seed)


SCENE = Scene(
    name="low-texture",
    summary="hard: a freshly painted, almost empty room, 0.8 to 6 m",
    mjcf=Path(__file__).with_name("bare.xml"),
    textures=_textures,
    motion=_motion,
    depth_range_m=(0.8, 6.0),
    edit=_edit,
)
