"""The room of the cases with high dynamic range: by day with a sunlit window, by night with a lamp.

Intensity 1 is a white card in good light; the cases are drawn in floating point, so the sky can be
at 100 and the corners of the room at 0.02.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator, default_rng

from eventsweep.scenes.parts import furniture as fu
from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.heads import centred
from eventsweep.scenes.parts.props import plant
from eventsweep.scenes.parts.shadows import cast
from eventsweep.scenes.parts.stock import made, stock
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.parts.furniture import Point
    from eventsweep.scenes.textures.noise import Image

_WINDOW: Point = (0.35, 3.5, 1.6)


def _day(spec: mujoco.MjSpec) -> None:
    """Sun on the garden; the room has what the window lets in."""
    _furnish(spec)
    _dim(spec, ambient=0.06, key=0.0)
    _lamp(spec, "window_light", _WINDOW, (0, -1, 0), 1.0, (0.5, 0.0, 0.9))
    for material, emission in {
        "sky": 120.0,
        "facade": 80.0,
        "lawn": 32.0,
        "foliage": 24.0,
        "bark": 16.0,
        "trim": 90.0,
        "roof": 24.0,
        "pane": 18.0,
    }.items():
        spec.material(material).emission = emission
    cast(spec, _WINDOW, keep=0.4, soft_m=0.05, floor_left="beech")


def _night(spec: mujoco.MjSpec) -> None:
    """A lamp on the desk, a lit window across the garden, and next to nothing else."""
    bulb_m = _furnish(spec)
    _dim(spec, ambient=0.005, key=0.004)
    _lamp(spec, "lamp_light", bulb_m, (0, 0, -1), 8.0, (0.25, 0.0, 6.0))
    for material, emission in {"bulb": 150.0, "pane": 0.9, "screen": 0.25, "sky": 0.012}.items():
        spec.material(material).emission = emission
    cast(spec, bulb_m, keep=0.25, soft_m=0.006, desk_0="beech")


def _dim(spec: mujoco.MjSpec, ambient: float, key: float) -> None:
    spec.visual.headlight.ambient = [ambient] * 3
    for name in ("key", "fill"):
        spec.light(name).diffuse = [key] * 3


def _lamp(
    spec: mujoco.MjSpec,
    name: str,
    at_m: Point,
    towards: Point,
    power: float,
    attenuation: Point,
) -> None:
    """Hangs a light for one half of space; at distance r it gives power / (a + b r + c r²)."""
    import mujoco

    spec.worldbody.add_light(
        name=name,
        # The classic renderer knows no point lights, but a spot of 90 degrees is half of one.
        type=mujoco.mjtLightType.mjLIGHT_SPOT,
        cutoff=90,
        exponent=0,
        pos=at_m,
        dir=towards,
        castshadow=False,
        diffuse=[power] * 3,
        ambient=[0, 0, 0],
        specular=[0, 0, 0],
        attenuation=attenuation,
    )


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx

    brick = ((0.5, 0.3, 0.22), (0.74, 0.52, 0.42))
    room = {
        "rug": lambda rng: tx.cloth((256, 384), rng, ((0.26, 0.12, 0.12), (0.66, 0.48, 0.4)), 48),
        "sofa": lambda rng: tx.cloth((256, 256), rng, ((0.16, 0.2, 0.16), (0.42, 0.48, 0.38)), 48),
        "crate": lambda rng: tx.crate(224, rng),
        "facade": lambda rng: tx.bricks((512, 512), rng, 40, 14, brick),
        "lawn": lambda rng: tx.plaster((384, 384), rng, ((0.2, 0.34, 0.12), (0.5, 0.64, 0.3))),
        "foliage": lambda rng: tx.solid(128, rng, (0.1, 0.24, 0.08), (0.6, 0.74, 0.4), fineness=5),
        "bark": lambda rng: tx.solid(96, rng, (0.2, 0.14, 0.1), (0.5, 0.4, 0.3), bands=9.0),
        "sky": _sky,
        "curtain": lambda rng: tx.cloth((256, 128), rng, ((0.4, 0.36, 0.3), (0.62, 0.58, 0.5)), 64),
    }
    return {**stock(241), **made(242, room)}


def _sky(rng: Generator) -> Image:
    """Broken clouds."""
    from eventsweep.scenes import textures as tx

    clouds = np.clip(2.2 * tx.fractal((384, 512), rng, 1.5) - 0.6, 0, 1)
    return tx.finish(tx.blend(clouds, (0.42, 0.58, 0.82), (0.96, 0.96, 0.95)))


def _furnish(spec: mujoco.MjSpec) -> Point:
    """Puts everything into the room; returns where the desk lamp's bulb is."""
    rng = default_rng(243)
    fu.table(spec, "desk", (-1.12, 1.85, 0), (1.3, 0.7, 0.74), 18)
    bulb_m = fu.desk_lamp(spec, "lamp", (-1.32, 2.05, 0.74), 18)
    fu.BodyBuilder(spec, "bulb", bulb_m).ball((0.03, 0.03, 0.026), (0, 0, 0), "bulb")
    fu.keyboard(spec, "keys", (-0.98, 1.66, 0.74), 14, mouse=False)
    fu.mug(spec, "mug", (-0.66, 1.86, 0.74), 40)
    at = fu.BodyBuilder(spec, "desk_things", (-1.12, 1.85, 0.74), 18)
    at.box((0.105, 0.148, 0.0008), (-0.3, -0.12, 0.001), "page_a", (0, 0, 14))
    for k in range(4):
        half = (0.014, 0.075, 0.11 - 0.006 * k)
        at.box(half, (0.14 + 0.032 * k, 0.2, half[2]), f"book_{2 * k}")
    fu.chair(spec, "chair", (-1.55, 1.3, 0), 215)
    fu.shelf(spec, "shelf", (1.82, 3.1, 0), (0.8, 0.28, 1.9), 5, rng, 0.85)
    _dark_corner(spec)
    _near(spec)
    _curtains(spec)
    plant(spec, "sill_plant", (0.82, 3.24, 1.08), 0.3, rng, leaves=8)
    _garden(spec, rng)
    return bulb_m


def _dark_corner(spec: mujoco.MjSpec) -> None:
    """Armchair, crate and cartons at the right, far from any light."""
    at = BodyBuilder(spec, "armchair", (1.5, 2.0, 0), -38)
    at.box((0.3, 0.3, 0.16), (0, 0, 0.28), "sofa")
    at.box((0.3, 0.08, 0.3), (0, 0.3, 0.66), "sofa", (-8, 0, 0))
    for x in (-0.36, 0.36):
        at.box((0.07, 0.3, 0.26), (x, 0, 0.36), "sofa")
    at.box((0.18, 0.05, 0.16), (0.02, 0.16, 0.6), "cloth", (-20, 0, 10))
    corner = BodyBuilder(spec, "corner", (0, 0, 0))
    corner.box((0.2, 0.2, 0.2), (0.72, 2.72, 0.2), "crate", (0, 0, 20))
    corner.box((0.14, 0.12, 0.11), (0.71, 2.70, 0.51), "carton_a", (0, 0, -10))
    corner.box((0.22, 0.18, 0.17), (-1.9, 2.95, 0.17), "carton_b", (0, 0, 12))


def _near(spec: mujoco.MjSpec) -> None:
    """A low table within a metre: what every view has in its lower half."""
    fu.table(spec, "low", (0.45, 1.0, 0), (1.0, 0.6, 0.74), 6)
    at = fu.BodyBuilder(spec, "low_things", (0.45, 1.0, 0.74), 6)
    at.box((0.1, 0.08, 0.075), (-0.24, 0.12, 0.075), "carton_a", (0, 0, 22))
    at.ball((0.07, 0.07, 0.07), (0.1, 0.12, 0.07), "ball", (60, 20, 0))
    at.box((0.105, 0.148, 0.018), (0.34, -0.05, 0.018), "book_3", (0, 0, 14))
    at.box((0.095, 0.135, 0.014), (0.33, -0.04, 0.05), "book_6", (0, 0, 30))
    at.drum(0.034, 0.058, (-0.06, -0.14, 0.058), "can")
    at.rod((-0.32, -0.2, 0.006), (-0.18, -0.16, 0.006), 0.005, "red")


def _curtains(spec: mujoco.MjSpec) -> None:
    at = BodyBuilder(spec, "curtains", (0, 3.22, 1.35))
    for side, first in ((-1, -0.40), (1, 1.10)):
        for k in range(4):
            x = first + side * 0.075 * k
            at.box((0.045, 0.006, 0.97), (x, 0, 0), "curtain", (0, 0, 32 * (-1) ** k))


def _garden(spec: mujoco.MjSpec, rng: Generator) -> None:
    """A tree, a hedge, and the windows and roof of the house across."""
    at = BodyBuilder(spec, "garden")
    at.rod((-0.5, 6.6, -0.3), (-0.42, 6.6, 2.0), 0.12, "bark")
    for a, b in (((-0.42, 6.6, 1.5), (0.3, 6.5, 2.4)), ((-0.42, 6.6, 1.7), (-1.1, 6.7, 2.6))):
        at.rod(a, b, 0.06, "bark")
    for _ in range(11):
        x, y, z = rng.uniform((-1.5, 6.2, 2.1), (0.8, 7.0, 3.2))
        size = float(rng.uniform(0.28, 0.5))
        at.ball((size, size, 0.75 * size), (x, y, z), "foliage", (0, 0, float(rng.uniform(0, 90))))
    for k in range(6):
        at.ball((0.55, 0.4, 0.42), (-2.6 + 0.85 * k, 8.2, 0.05), "foliage", (0, 0, 25 * k))
    for x in (0.85, 1.9, 2.95):
        for z in (0.7, 2.2):
            at.box((0.3, 0.03, 0.42), (x, 9.19, z), "trim")
            at.box((0.26, 0.035, 0.38), (x, 9.18, z), "pane")
            at.box((0.02, 0.04, 0.38), (x, 9.17, z), "trim")
            at.box((0.26, 0.04, 0.02), (x, 9.17, z + 0.1), "trim")
    at.box((1.9, 1.2, 0.1), (1.9, 10.2, 3.4), "roof")


SCENES = {
    name: Scene(
        name=name,
        summary=f"{shown}, 1000 to 1, 0.6 to 12 m",
        mjcf=Path(__file__).parents[1] / "den.xml",
        textures=_textures,
        motion=partial(centred, "six_dof", eye_m, target_m),
        depth_range_m=(0.6, 12.0),
        rig="tumvie-kb4",
        edit=edit,
        hdr=True,
        log_eps=0.001,
        frames_rate_hz=20.0,
    )
    for name, shown, edit, eye_m, target_m in (
        ("hdr-night", "a desk lamp in a dark room", _night, (-0.2, 0.0, 1.2), (-0.3, 3.0, 1.12)),
        ("hdr-window", "a dark room before a sunlit window", _day,
         (0.1, 0.0, 1.2), (0.15, 3.0, 1.32)),
    )
}  # fmt: skip
"""The cases of high dynamic range: a dark room by night, and beside a garden by day."""
