"""Twin of TUM-VIE running-easy: a run through a covered walk out into a yard."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.random import Generator, default_rng

from eventsweep.scenes.parts import outside as out
from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.outside import bench
from eventsweep.scenes.parts.props import plant
from eventsweep.scenes.parts.stock import made, painted
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import styled
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.textures import facades, outdoor
    from eventsweep.scenes.textures.facades import Front

    stone = ((0.42, 0.41, 0.38), (0.66, 0.64, 0.6))
    plank = ((0.3, 0.24, 0.18), (0.64, 0.55, 0.44))
    front_a, front_b = Front(4, 6, (0.74, 0.7, 0.62)), Front(3, 5, (0.6, 0.4, 0.3), brick=True)
    return made(
        331,
        {
            "sky": lambda rng: outdoor.sky(192, rng),
            "slabs": lambda rng: tx.tiles((512, 512), rng, 4, stone),
            "lawn": lambda rng: outdoor.grass((640, 640), rng),
            "soffit": lambda rng: tx.wood((256, 256), rng, planks=6, colours=plank),
            "wall": painted(0.6, (1, 0.97, 0.9), 0.08),
            "front_a": lambda rng: facades.facade((512, 640), rng, front_a),
            "front_b": lambda rng: facades.facade((512, 640), rng, front_b),
            "door_a": lambda rng: facades.door_leaf((512, 256), rng, (0.3, 0.38, 0.46)),
            "door_b": lambda rng: facades.door_leaf((512, 256), rng, (0.5, 0.38, 0.26)),
            "poster_a": lambda rng: tx.poster((512, 360), rng, (0.2, 0.34, 0.5), (0.86, 0.5, 0.22)),
            "board": lambda rng: tx.page((360, 512), rng, lines=18),
            "hedge": lambda rng: outdoor.hedge((192, 256), rng, 6.0),
            "leaves": lambda rng: outdoor.leaves(256, rng),
            "plank": lambda rng: tx.wood((96, 512), rng, colours=plank),
            "column": lambda rng: tx.solid(160, rng, *stone, fineness=4),
            "bark": lambda rng: outdoor.bark(128, rng),
            "bin": lambda rng: tx.solid(96, rng, (0.2, 0.24, 0.21), (0.36, 0.4, 0.36), fineness=5),
            "pot": lambda rng: tx.solid(96, rng, (0.46, 0.22, 0.14), (0.74, 0.48, 0.34)),
            "leaf": lambda rng: tx.solid(96, rng, (0.12, 0.28, 0.12), (0.42, 0.62, 0.3), bands=4),
        },
    )


def _edit(spec: mujoco.MjSpec) -> None:
    rng = default_rng(332)
    _arcade(spec)
    _things(spec, rng)
    _yard(spec, rng)


def _arcade(spec: mujoco.MjSpec) -> None:
    """Wall with doors at the left, columns at the right, beams and boards overhead."""
    at = BodyBuilder(spec, "arcade")
    at.box((0.2, 8.5, 1.6), (-1.9, 7.5, 1.6), "wall")
    at.box((2.0, 8.5, 0.1), (-0.1, 7.5, 3.2), "soffit")
    at.box((0.15, 8.5, 0.2), (1.75, 7.5, 3.0), "column")
    for k in range(6):
        y = 1.2 + 2.9 * k
        at.drum(0.17, 1.3, (1.75, y, 1.5), "column")
        at.box((0.24, 0.24, 0.12), (1.75, y, 0.12), "column")
        at.box((0.24, 0.24, 0.1), (1.75, y, 2.75), "column")
        at.box((1.7, 0.09, 0.11), (-0.1, y, 3.0), "plank")
    for k, y in enumerate((2.9, 6.9, 9.8, 13.6)):
        at.box((0.04, 0.52, 1.08), (-1.69, y, 1.08), f"door_{'ab'[k % 2]}")
        at.box((0.05, 0.07, 0.12), (-1.66, y + 0.85, 2.2), "white")
    for y, z, half, material in (
        (4.9, 1.7, (0.4, 0.56), "poster_a"), (8.3, 1.6, (0.5, 0.36), "board"),
        (11.7, 1.7, (0.4, 0.56), "poster_a"),
    ):  # fmt: skip
        at.box((0.015, *half), (-1.69, y, z), material)
    at.rod((-1.62, 0.5, 0.12), (-1.62, 16, 0.12), 0.03, "steel")
    for k in range(4):
        at.ball((0.14, 0.14, 0.1), (-0.1, 2.6 + 3.9 * k, 2.86), "white")


def _things(spec: mujoco.MjSpec, rng: Generator) -> None:
    """Benches, bins, pots and bicycle racks under the roof."""
    bench(spec, "bench", (-1.4, 5.0), 90)
    at = BodyBuilder(spec, "things")
    at.drum(0.2, 0.38, (-1.38, 7.9, 0.38), "bin")
    at.drum(0.2, 0.38, (1.7, 12.1, 0.38), "bin")
    for k, (x, y) in enumerate(((-1.4, 3.7), (-1.4, 10.9), (-1.4, 15.2))):
        at.drum(0.24, 0.22, (x, y, 0.22), "pot")
        plant(spec, f"plant_{k}", (x, y, 0.42), 0.95, rng, leaves=8)
    for k in range(5):
        y = 17.0 + 0.8 * k
        at.rod((1.5, y, 0), (1.5, y, 0.8), 0.03, "steel")
        at.rod((2.3, y, 0), (2.3, y, 0.8), 0.03, "steel")
        at.rod((1.5, y, 0.8), (2.3, y, 0.8), 0.03, "steel")
    at.box((0.35, 0.03, 0.12), (0.3, 15.6, 2.6), "board")


def _yard(spec: mujoco.MjSpec, rng: Generator) -> None:
    """Lawn, trees, hedges, a fence, and the buildings around them."""
    at = BodyBuilder(spec, "yard")
    at.box((9.0, 3.0, 6.5), (-1.0, 30.0, 6.5), "front_a")
    at.box((9.0, 3.0, 5.0), (17.0, 30.2, 5.0), "front_b")
    at.box((3.0, 6.4, 5.2), (-5.2, 22.6, 5.2), "front_b")
    at.box((3.0, 9.0, 4.6), (20.0, 18.3, 4.6), "front_a")
    at.box((0.5, 8.0, 0.5), (7.2, 17.0, 0.5), "hedge", (0, 0, -14))
    at.box((6.0, 0.5, 0.45), (11.0, 25.0, 0.45), "hedge")
    trees = out.Trees.grown(spec, "tree", rng, half_m=(1.9, 1.9, 1.8), leaf_m=0.075, leaves=2200)
    for k, (x, y) in enumerate(
        ((4.4, 9.4), (5.6, 14.2), (4.3, 19.4), (7.8, 22.5), (-1.2, 23.0), (10.5, 23.5), (3.0, 25.0))
    ):
        trees.plant(spec, f"tree_at_{k}", (x, y), float(rng.uniform(2.2, 2.8)), rng)
    out.lamp_post(spec, "lamp", (2.9, 22.0), 3.8, 180)
    out.bench(spec, "yard_bench", (3.4, 13.0), -90)
    out.fence(spec, "fence", (3.2, 6.0), (3.2, 11.5), every_m=1.8, height_m=0.9, rails=(0.45, 0.95))


SCENE = Scene(
    name="tumvie-run",
    summary="a run through a covered walk out into a yard, forward, 1 to 30 m",
    mjcf=Path(__file__).with_name("arcade.xml"),
    textures=_textures,
    motion=partial(styled, "run", look_at((0.05, 0.0, 1.68), (0.15, 10.0, 1.5))),
    depth_range_m=(1.0, 30.0),
    rig="tumvie-kb4",
    edit=_edit,
)
