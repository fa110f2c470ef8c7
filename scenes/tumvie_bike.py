"""Twin of TUM-VIE bike-easy: a ride through a park between trees, fences and houses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator, default_rng

from eventsweep.scenes.parts import mesh
from eventsweep.scenes.parts import outside as out
from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.outside import Trees, house, shade
from eventsweep.scenes.parts.stock import made
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import styled
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image

_BUSHES_M = (
    (-3.9, 7.6), (3.7, 9.9), (5.2, 19.5), (-5.6, 17.0), (-4.4, 27.5), (4.6, 30.5), (6.0, 12.0),
)  # fmt: skip
_OAKS_M = (
    (15.0, 34.0), (21.0, 42.0), (13.0, 55.0), (-14.0, 38.0), (-22.0, 60.0), (26.0, 62.0),
    (-13.0, 84.0), (18.0, 96.0), (-30.0, 95.0),
)  # fmt: skip


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.textures import facades, objects, outdoor

    dust = ((0.34, 0.31, 0.27), (0.72, 0.68, 0.6))
    plank = ((0.3, 0.24, 0.18), (0.64, 0.55, 0.44))
    fronts = {
        "a": facades.Front(2, 4, (0.8, 0.76, 0.66)),
        "b": facades.Front(3, 5, (0.6, 0.4, 0.3), brick=True),
        "c": facades.Front(2, 5, (0.72, 0.62, 0.5), (0.34, 0.26, 0.2)),
    }
    makers = {
        "sky": lambda rng: outdoor.sky(256, rng),
        "lawn": lambda rng: outdoor.grass((768, 768), rng),
        "path": lambda rng: outdoor.gravel((768, 768), rng, dust),
        "roof": lambda rng: outdoor.roof_tiles((384, 512), rng, 24),
        "hedge": lambda rng: outdoor.hedge((192, 256), rng, 5.0),
        "far_hedge": lambda rng: outdoor.hedge((192, 256), rng, 6.0),
        "plank": lambda rng: tx.wood((96, 512), rng, colours=plank),
        "leaves": lambda rng: outdoor.leaves(256, rng),
        "bark": lambda rng: outdoor.bark(128, rng),
        "chimney": lambda rng: tx.solid(96, rng, (0.3, 0.16, 0.12), (0.6, 0.36, 0.28), fineness=4),
        "far_wood": lambda rng: tx.solid(192, rng, (0.12, 0.2, 0.1), (0.44, 0.54, 0.3), fineness=6),
        "limit": lambda rng: objects.disc(96, rng, (0.3, 0.42, 0.7), "40"),
    }
    for key, front in fronts.items():
        makers[f"front_{key}"] = partial(facades.facade, (320, 512), front=front)
    return made(321, makers)


def _edit(spec: mujoco.MjSpec) -> None:
    rng = default_rng(322)
    _avenue(spec, rng)
    _roadside(spec)
    _village(spec)
    _horizon(spec, rng)


def _avenue(spec: mujoco.MjSpec, rng: Generator) -> None:
    """Trees along the path, bushes between them, and a copse on the right."""
    near = Trees.grown(spec, "lime", rng, half_m=(1.9, 1.9, 2.2), leaf_m=0.06, leaves=3200, kinds=2)
    wood = Trees.grown(spec, "oak", rng, half_m=(3.4, 3.4, 3.0), leaf_m=0.14, leaves=1600)
    for k in range(7):
        for side in (-1, 1):
            y = 11.0 + 10.5 * k + 4.0 * (side > 0) + float(rng.uniform(-0.8, 0.8))
            at = (side * (4.0 + float(rng.uniform(-0.3, 0.5))), y)
            name = f"tree_{k}_{'lmr'[side + 1]}"
            near.plant(spec, name, at, float(rng.uniform(2.4, 3.0)), rng)
    for k, (x, y) in enumerate(_OAKS_M):
        wood.plant(spec, f"oak_{k}", (x, y), float(rng.uniform(2.5, 3.6)), rng)
    for k in range(2):
        middles = mesh.crown(rng, 1100, (0.8, 0.8, 0.55), lumps=5)
        mesh.cards(spec, f"bush_{k}", middles, 0.045, rng)
    for k, (x, y) in enumerate(_BUSHES_M):
        mesh.place(spec, f"bush_{k % 2}", f"bush_at_{k}", (x, y, 0.5), "leaves", 77.0 * k)
        shade(spec, f"bush_shade_{k}", (x + 0.3, y + 0.3), (0.85, 0.8))


def _roadside(spec: mujoco.MjSpec) -> None:
    out.fence(spec, "fence_left", (-3.1, 5.5), (-3.1, 34.0), every_m=2.2)
    out.fence(spec, "fence_right", (3.1, 36.0), (3.1, 62.0), every_m=3.0)
    out.fence(spec, "paddock", (6.8, 14.0), (30.0, 24.0), every_m=3.0, rails=(0.4, 0.95))
    out.bench(spec, "bench", (2.35, 16.0), -90)
    out.lamp_post(spec, "lamp_0", (2.2, 12.6), 3.9, 180)
    out.lamp_post(spec, "lamp_1", (2.2, 33.0), 3.9, 180)
    out.lamp_post(spec, "lamp_2", (2.2, 54.0), 3.9, 180)
    out.sign(spec, "sign", (-2.0, 21.0), "limit")
    at = BodyBuilder(spec, "roadside")
    at.drum(0.2, 0.42, (2.3, 18.4, 0.42), "steel")
    for k in range(9):
        at.ball((0.16, 0.14, 0.1), (-1.72 + 0.12 * (k % 2), 8.0 + 2.7 * k, 0.05), "chimney")
    for k in range(6):
        at.rod((1.9, 7.2 + 3.1 * k, 0), (1.9, 7.2 + 3.1 * k, 0.7), 0.07, "plank")


def _village(spec: mujoco.MjSpec) -> None:
    places = (
        (-15.0, 47.0, (5.0, 4.0, 2.9), "a", 12), (12.5, 74.0, (6.0, 4.5, 3.0), "c", -8),
        (-26.0, 76.0, (7.0, 5.0, 4.2), "b", 20), (34.0, 88.0, (7.0, 5.0, 3.0), "a", -20),
        (3.0, 128.0, (8.0, 5.0, 4.3), "b", 4), (-17.0, 118.0, (6.0, 4.5, 3.0), "c", 10),
        (24.0, 124.0, (6.5, 5.0, 3.0), "a", -12), (-52.0, 120.0, (7.0, 5.0, 3.2), "c", 25),
    )  # fmt: skip
    for k, (x, y, half, key, yaw) in enumerate(places):
        house(spec, f"house_{k}", (x, y), half, f"front_{key}", yaw_deg=yaw)
    church = BodyBuilder(spec, "church", (-6.0, 150.0, 0))
    church.box((2.6, 2.6, 9.5), (0, 0, 9.5), "front_b")
    for k in range(6):
        side = 2.6 * (1 - k / 6.2)
        church.box((side, side, 0.8), (0, 0, 19.8 + 1.6 * k), "roof")


def _horizon(spec: mujoco.MjSpec, rng: Generator) -> None:
    """Hedges between the fields and a wooded ridge at the far end."""
    at = BodyBuilder(spec, "horizon")
    at.box((14, 0.8, 0.9), (-24, 30.0, 0.9), "hedge", (0, 0, 6))
    at.box((18, 1.0, 1.0), (36, 50.0, 1.0), "hedge", (0, 0, -10))
    at.box((30, 1.0, 1.2), (-48, 100.0, 1.2), "hedge")
    for k, x in enumerate(np.linspace(-120, 120, 13)):
        half = (16.0, 6.0, float(rng.uniform(5, 9)))
        at.ball(half, (float(x), 184.0 + 4 * (k % 2), half[2] * 0.4), "far_wood")
    at.box((160, 0.5, 2.0), (0, 182.0, 2.0), "far_hedge")


SCENE = Scene(
    name="tumvie-bike",
    summary="a ride through a park between trees, fences and houses, forward, 3 to 200 m",
    mjcf=Path(__file__).with_name("park.xml"),
    textures=_textures,
    motion=partial(styled, "bike", look_at((0.3, 0.0, 1.85), (0.3, 20.0, 1.85))),
    depth_range_m=(3.0, 200.0),
    rig="tumvie-kb4",
    edit=_edit,
)
