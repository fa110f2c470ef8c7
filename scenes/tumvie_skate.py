"""Twin of TUM-VIE skate-easy: a skater glides down a long corridor."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.random import default_rng

from eventsweep.scenes.parts import furniture as fu
from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.props import plant
from eventsweep.scenes.parts.shadows import bake
from eventsweep.scenes.parts.stock import faded, made, painted
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import styled
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image

_WALL_M = 1.3
"""The walls stand at this distance from the middle."""


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.parts.print import plain_carton
    from eventsweep.scenes.textures import facades

    lino = ((0.30, 0.33, 0.33), (0.52, 0.54, 0.52))
    panel = ((0.62, 0.62, 0.6), (0.8, 0.8, 0.78))
    return made(
        311,
        {
            "lino": lambda rng: tx.plaster((2304, 288), rng, lino, relief=0.5),
            "wall": painted(0.64, (1, 0.99, 0.95), 0.07),
            "ceiling": lambda rng: tx.tiles((256, 256), rng, 2, panel),
            "door_a": lambda rng: facades.door_leaf((512, 256), rng, (0.3, 0.38, 0.46)),
            "door_b": lambda rng: facades.door_leaf((512, 256), rng, (0.56, 0.42, 0.28)),
            "door_c": lambda rng: facades.door_leaf((512, 256), rng, (0.46, 0.47, 0.46)),
            "lockers": lambda rng: facades.lockers((480, 640), rng, 6, (0.34, 0.44, 0.52)),
            "board": lambda rng: tx.cork((256, 384), rng),
            "poster_a": lambda rng: tx.poster((512, 360), rng, (0.2, 0.34, 0.5), (0.86, 0.5, 0.22)),
            "poster_b": lambda rng: tx.page((512, 360), rng, lines=30),
            "exit_sign": lambda rng: tx.label((96, 256), rng, (0.12, 0.42, 0.24)),
            "lamp": painted(0.9, (1, 1, 1), 0.01),
            "wood": lambda rng: tx.solid(128, rng, (0.4, 0.28, 0.17), (0.62, 0.46, 0.3), bands=4),
            "bin": lambda rng: tx.solid(96, rng, (0.2, 0.21, 0.22), (0.36, 0.37, 0.38), fineness=5),
            "pot": lambda rng: tx.solid(96, rng, (0.46, 0.22, 0.14), (0.74, 0.48, 0.34)),
            "leaf": lambda rng: tx.solid(96, rng, (0.12, 0.28, 0.12), (0.42, 0.62, 0.3), bands=4),
            "carton": faded(lambda rng: plain_carton(192, rng), 0.2),
        },
    )


def _edit(spec: mujoco.MjSpec) -> None:
    _doors(spec)
    _walls(spec)
    _standing(spec)
    bake(spec, floor="lino")
    _ceiling(spec)


def _doors(spec: mujoco.MjSpec) -> None:
    at = BodyBuilder(spec, "doors")
    places = (
        (-1, 3.1),
        (-1, 6.6),
        (-1, 11.6),
        (-1, 16.4),
        (1, 4.4),
        (1, 9.4),
        (1, 13.0),
        (1, 17.6),
    )
    for k, (side, y) in enumerate(places):
        leaf = f"door_{'abc'[k % 3]}"
        # The -x face of a box shows its picture mirrored, so what hangs at the right is turned.
        at.box((0.03, 0.5, 1.06), (side * _WALL_M, y, 1.06), leaf, (0, 0, 90 + 90 * side))
        at.box((0.012, 0.09, 0.06), (side * (_WALL_M - 0.01), y + 0.72, 1.5), "white")
    for x in (-0.52, 0.52):
        at.box((0.5, 0.03, 1.1), (x, 19.64, 1.1), "door_a")
    # One door stands open into the corridor, one leaf of a fire door is folded back.
    at.box((0.03, 0.48, 1.05), (1.06, 10.34, 1.05), "door_b", (0, 0, 208))
    at.box((0.03, 0.46, 1.05), (-1.14, 14.1, 1.05), "door_c", (0, 0, -14))
    for side in (-1, 1):
        at.box((0.16, 0.05, 1.4), (side * 1.15, 14.6, 1.4), "wood")
    at.box((1.3, 0.05, 0.2), (0, 14.6, 2.6), "wood")


def _walls(spec: mujoco.MjSpec) -> None:
    """Skirting boards, hand rail, posters and notice boards."""
    at = BodyBuilder(spec, "on_walls")
    for side in (-1, 1):
        at.box((0.012, 11.5, 0.05), (side * (_WALL_M - 0.01), 9, 0.05), "skirting")
    at.rod((1.22, 5.2, 0.95), (1.22, 8.7, 0.95), 0.022, "rail")
    for y in (5.4, 6.5, 7.6, 8.5):
        at.rod((1.22, y, 0.93), (1.29, y, 0.88), 0.01, "steel")
    for side, y, z, half, material in (
        (1, 6.9, 1.6, (0.42, 0.55), "board"), (-1, 4.8, 1.62, (0.35, 0.5), "poster_a"),
        (-1, 9.0, 1.6, (0.6, 0.42), "board"), (1, 11.3, 1.6, (0.35, 0.5), "poster_a"),
        (-1, 13.1, 1.6, (0.35, 0.5), "poster_b"), (1, 15.4, 1.6, (0.35, 0.5), "poster_b"),
    ):  # fmt: skip
        turn = (0, 0, 90 + 90 * side)
        at.box((0.012, *half), (side * (_WALL_M - 0.01), y, z), material, turn)
    sheets = ((-1, 8.7, 1.75), (-1, 9.05, 1.5), (-1, 9.3, 1.78), (1, 6.7, 1.7), (1, 7.1, 1.55))
    for k, (side, y, z) in enumerate(sheets):
        at.box((0.003, 0.105, 0.148), (side * (_WALL_M - 0.024), y, z), f"poster_{'ba'[k % 2]}")


def _standing(spec: mujoco.MjSpec) -> None:
    """Lockers, cabinet, chairs, bins, plants and cartons along the walls."""
    rng = default_rng(312)
    at = fu.BodyBuilder(spec, "standing")
    for y in (7.9, 9.66):
        at.box((0.22, 0.87, 0.9), (-1.06, y + 2.6, 0.9), "lockers")
    at.box((0.24, 0.44, 0.52), (1.05, 2.55, 0.52), "wood")
    at.box((0.17, 0.13, 0.11), (1.04, 2.4, 1.15), "carton", (0, 0, 20))
    at.drum(0.14, 0.3, (1.1, 3.4, 0.3), "bin")
    at.drum(0.14, 0.3, (-1.1, 12.6, 0.3), "bin")
    at.box((0.24, 0.3, 0.25), (1.02, 8.3, 0.25), "carton", (0, 0, -12))
    at.box((0.18, 0.2, 0.17), (1.04, 8.28, 0.67), "carton", (0, 0, 16))
    for k, y in enumerate((4.6, 5.25)):
        fu.chair(spec, f"chair_{k}", (-0.98, y, 0), 90)
    for k, (x, y) in enumerate(((-1.05, 2.1), (1.08, 12.1), (-1.05, 15.3))):
        at.drum(0.16, 0.17, (x, y, 0.17), "pot")
        plant(spec, f"plant_{k}", (x, y, 0.33), 0.75, rng, leaves=9)
    at.rod((-1.2, 5.9, 0.35), (-1.2, 5.9, 0.85), 0.075, "red")
    at.rod((-1.2, 5.9, 0.9), (-1.12, 5.98, 0.95), 0.012, "skirting")
    at.box((0.03, 0.16, 0.3), (1.27, 14.1, 1.3), "red")


def _ceiling(spec: mujoco.MjSpec) -> None:
    """Lamps, exit signs, smoke detectors and pipes: too high for the shadows on the floor."""
    at = BodyBuilder(spec, "ceiling_things")
    for k in range(8):
        at.box((0.14, 0.6, 0.02), (0, 1.4 + 2.5 * k, 2.73), "lamp")
        at.drum(0.05, 0.02, (0.5, 2.6 + 2.5 * k, 2.73), "white")
    for y in (8.2, 14.5):
        at.box((0.28, 0.02, 0.1), (0.3, y, 2.42), "exit_sign")
        for x in (0.08, 0.52):
            at.rod((x, y, 2.52), (x, y, 2.76), 0.006, "steel")
    for z in (2.5, 2.62):
        at.rod((-1.24, -1.5, z), (-1.24, 19.5, z), 0.03, "pipe")
    for k in range(8):
        at.box((0.05, 0.02, 0.1), (-1.25, 1.2 + 2.4 * k, 2.56), "steel")


SCENE = Scene(
    name="tumvie-skate",
    summary="a skater glides down a long corridor, forward, 1 to 20 m",
    mjcf=Path(__file__).with_name("corridor.xml"),
    textures=_textures,
    motion=partial(styled, "skate", look_at((0.0, 0.0, 1.72), (0.0, 10.0, 1.5))),
    depth_range_m=(1.0, 20.0),
    rig="tumvie-kb4",
    edit=_edit,
)
