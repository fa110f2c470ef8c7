"""Boxes, drums, balls and tools at many depths in a store room, under free motion."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator, default_rng

from eventsweep.scenes.parts.props import box, cable, rod
from eventsweep.scenes.parts.shadows import bake
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import HeadSway, Wave, look_at
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image

_GOODS = ("carton_a", "carton_b", "carton_c", "crate", "toolbox")


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes.textures.noise import streams

    return {**_room(streams(31, 9)), **_things(streams(32, 15))}


def _room(rng: list[Generator]) -> dict[str, Image]:
    from eventsweep.scenes import textures as tx

    concrete = ((0.3, 0.31, 0.31), (0.92, 0.91, 0.86))
    return {
        "floor": tx.tiles((1024, 1024), rng[0], 12, concrete),
        "brick": tx.bricks((1024, 1024), rng[1], courses=26, per_course=9),
        "plaster": tx.plaster((1024, 1024), rng[2], ((0.38, 0.4, 0.36), (0.9, 0.9, 0.84))),
        "back": tx.bricks(
            (1024, 1024),
            rng[3],
            courses=12,
            per_course=6,
            colours=((0.3, 0.36, 0.38), (0.72, 0.78, 0.76)),
            mortar=(0.86, 0.85, 0.8),
        ),
        "oak": tx.wood((128, 512), rng[4]),
        "bench": tx.wood(
            (640, 1024), rng[5], planks=6, colours=((0.26, 0.17, 0.1), (0.92, 0.74, 0.5))
        ),
        "sheet": tx.page((600, 880), rng[6], lines=30),
        "poster": tx.poster((768, 560), rng[7], (0.5, 0.24, 0.2), (0.86, 0.74, 0.3)),
        "plan": tx.page((640, 880), rng[8], lines=40),
    }


def _things(rng: list[Generator]) -> dict[str, Image]:
    from eventsweep.scenes import textures as tx

    return {
        "crate": tx.crate(384, rng[0]),
        "carton_a": tx.carton(384, rng[1], (0.2, 0.4, 0.6)),
        "carton_b": tx.carton(384, rng[2], (0.62, 0.22, 0.18)),
        "carton_c": tx.carton(384, rng[3], (0.24, 0.46, 0.3)),
        "block_a": tx.toy_block(160, rng[4], (0.66, 0.2, 0.16)),
        "block_b": tx.toy_block(160, rng[5], (0.16, 0.34, 0.58)),
        "drum": tx.drum(384, rng[6], (0.2, 0.42, 0.6)),
        "drum_b": tx.drum(384, rng[14], (0.62, 0.52, 0.3)),
        "can": tx.can(256, rng[7], (0.72, 0.42, 0.16)),
        "enamel": tx.solid(192, rng[13], (0.14, 0.34, 0.28), (0.5, 0.72, 0.6), fineness=2.5),
        "ball": tx.ball(256, rng[8], ((0.74, 0.22, 0.16), (0.88, 0.86, 0.78), (0.2, 0.36, 0.6))),
        "stone": tx.solid(256, rng[9], (0.24, 0.26, 0.24), (0.82, 0.8, 0.74), fineness=2.0),
        "metal": tx.solid(192, rng[10], (0.36, 0.37, 0.39), (0.7, 0.71, 0.73), fineness=6.0),
        "toolbox": tx.solid(256, rng[11], (0.46, 0.1, 0.1), (0.84, 0.4, 0.34), fineness=3.0),
        "handle": tx.solid(128, rng[12], (0.34, 0.2, 0.1), (0.84, 0.62, 0.4), bands=12.0),
    }


def _edit(spec: mujoco.MjSpec) -> None:
    rng = default_rng(34)
    _rack(spec, rng)
    _ladder(spec)
    cord = [(*at, 0.01) for at in ((0.9, 2.2), (0.5, 2.0), (0.2, 2.9), (-0.4, 2.6), (-0.3, 3.2))]
    cable(spec, "floor_cord", cord, 0.009, "yellow")
    bake(spec, floor="floor", bench="bench")


def _rack(spec: mujoco.MjSpec, rng: Generator) -> None:
    """A rack along the back wall, left, with boxes of all sizes on its boards."""
    from scipy.spatial.transform import Rotation

    left, right, y = -2.1, -0.35, 5.3
    for k, x in enumerate((left, left, right, right)):
        at_m = (x, y + (-0.2, 0.2)[k % 2], 1.1)
        box(spec, f"rack_post_{k}", (0.02, 0.02, 1.1), at_m, "metal")
    for board, z in enumerate((0.25, 0.85, 1.45, 2.0)):
        half_m = ((right - left) / 2, 0.22, 0.015)
        box(spec, f"rack_board_{board}", half_m, ((left + right) / 2, y, z), "oak")
        x = left + 0.06
        while x < right - 0.3:
            half = rng.uniform((0.08, 0.08, 0.07), (0.17, 0.17, 0.2))
            at_m = (x + half[0], y - 0.03, z + 0.015 + half[2])
            turned = Rotation.from_rotvec([0, 0, rng.uniform(-0.2, 0.2)])
            name = f"rack_box_{board}_{round(100 * (x - left))}"
            box(spec, name, half, at_m, str(rng.choice(_GOODS)), turned)
            x += 2 * half[0] + rng.uniform(0.04, 0.14)


def _ladder(spec: mujoco.MjSpec) -> None:
    """Leans a ladder against the right wall: two rails and nine rungs."""
    foot, head = np.array([1.75, 4.5, 0.0]), np.array([2.4, 4.5, 2.5])
    side = np.array([0.0, 0.21, 0.0])
    for name, shift in (("near", -side), ("far", side)):
        rod(spec, f"ladder_{name}", foot + shift, head + shift, 0.022, "handle")
    for rung in range(9):
        middle = foot + (head - foot) * (rung + 0.6) / 9.2
        rod(spec, f"ladder_rung_{rung}", middle - side, middle + side, 0.014, "handle")


def _motion(_duration_s: float, seed: int) -> HeadSway:
    """A head that ducks, leans and looks around in all six degrees of freedom."""
    rng = default_rng(seed)
    rest = look_at((0.02, 0.0, 1.38), (0.06, 3.0, 0.92))
    side = float(rng.choice((-1.0, 1.0)))
    start = float(-np.pi / 2 + rng.uniform(0.1, 0.6))
    lean = Wave(
        1.25,
        (side * float(rng.uniform(0.11, 0.14)), float(rng.uniform(0.03, 0.05)), 0.04),
        (float(rng.uniform(2.0, 3.5)), -side * float(rng.uniform(2.5, 4.0)), side * 4.0),
        (
            start,
            start + float(rng.uniform(0.3, 1.2)),
            *rng.uniform(0, 2 * np.pi, 2).tolist(),
            start,
            start,
        ),
    )
    look = Wave(
        0.55,
        (0.010, 0.012, 0.008),
        (0.9, 0.8, 0.9),
        tuple(rng.uniform(0, 2 * np.pi, 6).tolist()),
    )
    return HeadSway(rest, (lean, look))


SCENE = Scene(
    name="boxes",
    summary="boxes, drums, balls and tools in a store room, six-DoF motion, 0.6 to 6 m",
    mjcf=Path(__file__).with_suffix(".xml"),
    textures=_textures,
    motion=_motion,
    depth_range_m=(0.6, 6.0),
    edit=_edit,
)
