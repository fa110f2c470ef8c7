"""Twin of DSEC: a car drives down a street between parked cars and houses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator, default_rng

from eventsweep.scenes.parts import outside as out
from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.props import cable
from eventsweep.scenes.parts.stock import made
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import HeadSway, Wave, look_at
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image

_PAINTS = {"a": (0.62, 0.24, 0.2), "b": (0.72, 0.74, 0.76), "c": (0.26, 0.38, 0.56)}
_END_M = 49.0
_SPEED_M_S, _BUMPS_HZ = 9.0, 1.5


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.textures import facades, objects, outdoor

    slabs = ((0.44, 0.43, 0.41), (0.68, 0.67, 0.63))
    fronts = {
        "a": facades.Front(4, 4, (0.74, 0.66, 0.5), shop=True),
        "b": facades.Front(4, 3, (0.6, 0.4, 0.3), brick=True),
        "c": facades.Front(3, 4, (0.62, 0.66, 0.68), (0.3, 0.28, 0.27), shop=True),
        "d": facades.Front(4, 4, (0.78, 0.74, 0.68)),
        "e": facades.Front(5, 9, (0.66, 0.6, 0.52), shop=True),
    }
    makers = {
        "sky": lambda rng: outdoor.sky(192, rng),
        "road": lambda rng: outdoor.asphalt((768, 768), rng, 0.27),
        "pavement": lambda rng: tx.tiles((384, 384), rng, 6, slabs),
        "leaves": lambda rng: outdoor.leaves(256, rng),
        "bark": lambda rng: outdoor.bark(96, rng),
        "wheel": lambda rng: objects.wheel(96, rng),
        "stop": lambda rng: objects.disc(96, rng, (0.7, 0.14, 0.12), "STOP"),
        "limit": lambda rng: objects.disc(96, rng, (0.85, 0.85, 0.83), "30"),
    }
    for key, front in fronts.items():
        makers[f"front_{key}"] = partial(facades.facade, (512, 512), front=front)
    for key, paint in _PAINTS.items():
        makers[f"paint_{key}"] = partial(objects.car_side, (128, 640), colour=paint)
        makers[f"paint_{key}_cabin"] = partial(objects.car_cabin, (96, 384), colour=paint)
    return made(301, makers)


def _edit(spec: mujoco.MjSpec) -> None:
    rng = default_rng(302)
    _houses(spec)
    _cars(spec, rng)
    trees = out.Trees.grown(spec, "plane", rng, half_m=(1.7, 1.7, 1.7), leaf_m=0.065, leaves=2200)
    for k, (x, y) in enumerate(((-5.3, 15.0), (5.35, 21.5), (-5.3, 29.0), (5.35, 37.0))):
        trees.plant(spec, f"tree_{k}", (x, y), 3.0, rng, shadow=None)
    for k, (x, y) in enumerate(((5.0, 11.5), (-5.0, 21.5), (5.0, 30.0), (-5.0, 40.0))):
        out.lamp_post(spec, f"lamp_{k}", (x, y), 6.0, 180 if x > 0 else 0)
    out.sign(spec, "sign_limit", (4.8, 14.5), "limit")
    out.sign(spec, "sign_stop", (4.75, 41.0), "stop")
    out.sign(spec, "sign_left", (-4.8, 18.4), "limit", 2.4)
    _pavements(spec)
    _paint(spec)
    _wires(spec)


def _houses(spec: mujoco.MjSpec) -> None:
    rows = {-1: "dabcd", 1: "bcdab"}
    for side, order in rows.items():
        y = -1.0
        for k, key in enumerate(order):
            half = (5.2, 5.9, 5.0, 6.1, 5.4)[(k + (side > 0) * 2) % 5]
            height = (6.0, 7.0, 5.2, 6.4, 6.6)[(k * 2 + (side > 0)) % 5]
            wall = BodyBuilder(
                spec, f"house_{'lmr'[side + 1]}_{k}", (side * 10.6, y + half, 0), 90 + 90 * side
            )
            wall.box((3.0, half - 0.02, height), (0, 0, height), f"front_{key}")
            wall.box((3.15, half, 0.12), (0, 0, 2 * height), "steel")
            y += 2 * half
    end = BodyBuilder(spec, "house_end", (0, _END_M + 3.0, 0))
    end.box((14, 3, 8.5), (0, 0, 8.5), "front_e")


def _cars(spec: mujoco.MjSpec, rng: Generator) -> None:
    for side in (-1, 1):
        y = 6.4 if side < 0 else 9.2
        for k in range(6):
            paint = "paint_" + "abc"[int(rng.integers(3))]
            yaw = 90.0 * side * -1 + float(rng.uniform(-2, 2))
            at = (side * (3.55 + float(rng.uniform(-0.06, 0.06))), y)
            out.car(spec, f"car_{'lmr'[side + 1]}_{k}", at, yaw, paint)
            y += 5.2 + float(rng.uniform(0, 1.6)) + (3.0 if k == 2 else 0.0)


def _pavements(spec: mujoco.MjSpec) -> None:
    """Kerbs, bollards, bins, a bicycle stand and boxes of the post."""
    at = BodyBuilder(spec, "pavement_things")
    for side in (-1, 1):
        at.box((0.1, 25, 0.075), (side * 4.55, 24, 0.07), "line")
    for k in range(5):
        at.rod((-4.85, 11.5 + 1.4 * k, 0), (-4.85, 11.5 + 1.4 * k, 0.95), 0.06, "steel")
    for x, y, material in ((6.6, 16.0, "green"), (6.6, 16.75, "yellow"), (-6.9, 25.0, "yellow")):
        at.box((0.3, 0.32, 0.55), (x, y, 0.67), material)
    for y in (24.0, 24.8, 25.6):
        at.rod((5.0, y, 0.1), (5.0, y, 0.9), 0.03, "steel")
        at.rod((5.7, y, 0.1), (5.7, y, 0.9), 0.03, "steel")
        at.rod((5.0, y, 0.9), (5.7, y, 0.9), 0.03, "steel")
    for k in range(3):
        at.box((0.9, 0.9, 0.03), (-6.4, 33.0 + 2.6 * k, 2.3), "red", (0, 6, 0))
        at.rod((-6.4, 33.0 + 2.6 * k, 0), (-6.4, 33.0 + 2.6 * k, 2.3), 0.03, "steel")


def _paint(spec: mujoco.MjSpec) -> None:
    """Road markings: dashes in the middle, a crossing, parking bays."""
    at = BodyBuilder(spec, "markings")
    for k in range(7):
        at.box((0.07, 0.9, 0.004), (0.05, 5.0 + 4.2 * k, 0), "line")
    for k in range(6):
        at.box((0.24, 1.5, 0.004), (-2.4 + 0.95 * k, 42.5, 0), "line")
    for side in (-1, 1):
        for k in range(5):
            at.box((0.95, 0.05, 0.004), (side * 3.5, 4.0 + 6.3 * k + 2.6 * (side > 0), 0), "line")


def _wires(spec: mujoco.MjSpec) -> None:
    for k, (y, z) in enumerate(((13.0, 7.4), (27.0, 7.8))):
        points = [(-7.6, y, z), (-2.5, y, z - 0.55), (2.5, y, z - 0.55), (7.6, y, z)]
        cable(spec, f"wire_{k}", points, 0.02, "wire")


def _motion(_duration_s: float, seed: int) -> HeadSway:
    """Straight on at 9 m/s, on a road of 1.5 bumps a second, with slow turns of the car."""
    rng = np.random.default_rng(seed)
    rest = look_at((-0.3, 0.0, 2.0), (-0.3, 20.0, 1.95))
    level = np.array([rest[0, 2], rest[1, 2], 0.0])
    way_m_s = rest[:3, :3].T @ (_SPEED_M_S * level / np.linalg.norm(level))
    bump, sway, slow = (tuple(rng.uniform(0, 2 * np.pi, 6).tolist()) for _ in range(3))
    waves = (
        Wave(1 / _BUMPS_HZ, (0, 0.006, 0.3 * 0.006), (0.15, 0, 0), bump),
        Wave(2 / _BUMPS_HZ, (0.002, 0, 0), (0, 0.1, 0.15), sway),
        Wave(5.0, (0, 0, 0), (0.1, 0.6, 0.1), slow),
    )
    return HeadSway(rest, waves, (float(way_m_s[0]), float(way_m_s[1]), float(way_m_s[2])))


SCENE = Scene(
    name="dsec-street",
    summary="a car drives down a street of parked cars and houses, 4 to 50 m",
    mjcf=Path(__file__).with_name("street.xml"),
    textures=_textures,
    motion=_motion,
    depth_range_m=(4.0, 50.0),
    rig="dsec",
    edit=_edit,
)
