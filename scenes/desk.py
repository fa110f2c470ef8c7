"""A cluttered desk as a seated person's head sees it, from the keyboard to the brick wall."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator, default_rng

from eventsweep.scenes.parts.props import book_row, box, cable, plant
from eventsweep.scenes.parts.shadows import bake
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import HeadSway, Wave, look_at
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Colour, Image

_BOOK_COLOURS: tuple[tuple[Colour, Colour], ...] = (
    ((0.52, 0.16, 0.14), (0.86, 0.76, 0.45)),
    ((0.16, 0.27, 0.46), (0.85, 0.84, 0.78)),
    ((0.74, 0.66, 0.48), (0.24, 0.16, 0.12)),
    ((0.18, 0.38, 0.28), (0.88, 0.80, 0.52)),
    ((0.82, 0.80, 0.74), (0.55, 0.18, 0.16)),
    ((0.30, 0.26, 0.28), (0.82, 0.62, 0.30)),
    ((0.78, 0.52, 0.22), (0.20, 0.16, 0.20)),
    ((0.42, 0.52, 0.60), (0.16, 0.18, 0.24)),
)


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx

    books = zip(tx.streams(13, 8), _BOOK_COLOURS, strict=True)
    return {
        **_room(tx.streams(11, 11)),
        **_things(tx.streams(12, 15)),
        **{f"book_{k}": tx.book(256, rng, *colours) for k, (rng, colours) in enumerate(books)},
    }


def _room(rng: list[Generator]) -> dict[str, Image]:
    from eventsweep.scenes import textures as tx

    return {
        "desk_top": tx.wood((1024, 2048), rng[0]),
        "floor": tx.wood((1024, 1024), rng[1], planks=24),
        "brick": tx.bricks((1024, 1024), rng[2], courses=28, per_course=10),
        "plaster": tx.plaster((1024, 1024), rng[3], ((0.35, 0.36, 0.32), (0.92, 0.9, 0.82))),
        "oak": tx.wood((128, 1024), rng[4], colours=((0.26, 0.17, 0.1), (0.8, 0.62, 0.42))),
        "cork": tx.cork((512, 512), rng[5]),
        "blue_cloth": tx.cloth((512, 512), rng[6], ((0.06, 0.12, 0.26), (0.6, 0.68, 0.82))),
        "rug": tx.cloth((512, 1024), rng[7], ((0.3, 0.1, 0.1), (0.85, 0.62, 0.5)), threads=96),
        "poster_a": tx.poster((768, 512), rng[8], (0.2, 0.34, 0.5), (0.86, 0.5, 0.22)),
        "poster_b": tx.poster((768, 512), rng[9], (0.36, 0.3, 0.2), (0.75, 0.3, 0.22)),
        "poster_c": tx.poster((768, 512), rng[10], (0.2, 0.42, 0.34), (0.88, 0.78, 0.4)),
    }


def _things(rng: list[Generator]) -> dict[str, Image]:
    from eventsweep.scenes import textures as tx

    plastic = ((0.3, 0.31, 0.33), (0.62, 0.63, 0.64))
    return {
        "keyboard": tx.keyboard((330, 1024), rng[0]),
        "screen": tx.screen((720, 1280), rng[1]),
        "page_a": tx.page((1024, 724), rng[2]),
        "page_b": tx.page((1024, 724), rng[3], lines=38),
        "page_c": tx.page((1024, 724), rng[4], lines=52),
        "note": tx.label((256, 256), rng[5], (0.8, 0.62, 0.2)),
        "grey_plastic": tx.plaster((512, 512), rng[6], plastic, relief=0.5),
        "mug": tx.solid(256, rng[7], (0.14, 0.28, 0.5), (0.92, 0.9, 0.82), bands=9.0),
        "pot": tx.solid(256, rng[8], (0.4, 0.17, 0.1), (0.86, 0.58, 0.42)),
        "ball": tx.solid(256, rng[9], (0.2, 0.34, 0.42), (0.9, 0.86, 0.5), bands=5.0),
        "metal": tx.solid(192, rng[10], (0.36, 0.37, 0.39), (0.68, 0.69, 0.7), fineness=6.0),
        "mouse": tx.solid(128, rng[14], (0.2, 0.2, 0.22), (0.4, 0.4, 0.43), fineness=4.0),
        "leaf": tx.solid(128, rng[11], (0.08, 0.24, 0.1), (0.5, 0.72, 0.34), bands=7.0),
        "carton_a": tx.carton(384, rng[12], (0.2, 0.4, 0.6)),
        "carton_b": tx.carton(384, rng[13], (0.62, 0.22, 0.18)),
    }


def _edit(spec: mujoco.MjSpec) -> None:
    rng = default_rng(14)
    for board, top_m in enumerate((0.112, 0.472, 0.812, 1.142, 1.472)):
        start = 0.64 + 0.05 * rng.random()
        width = rng.uniform(0.55, 0.85)
        book_row(spec, f"shelf_book_{board}", (start, 2.28, top_m), width, (0.2, 0.29), rng)
    book_row(spec, "desk_book", (0.36, 0.80, 0.74), 0.16, (0.17, 0.24), rng, depth_m=0.075)
    _stack(spec, rng)
    plant(spec, "plant", (0.66, 0.74, 0.85), 0.26, rng)
    behind = [(-0.06, 0.50, 0.744), (0.02, 0.60, 0.744), (-0.05, 0.68, 0.744), (0.04, 0.90, 0.744)]
    cable(spec, "keyboard_cable", behind, 0.0028, "cable")
    tail = [(0.21, 0.475, 0.746), (0.17, 0.56, 0.744), (0.12, 0.66, 0.744), (0.10, 0.92, 0.744)]
    cable(spec, "mouse_cable", tail, 0.002, "cable")
    bake(spec, desk_top="desk_top", floor="floor")


def _stack(spec: mujoco.MjSpec, rng: Generator) -> None:
    """Lays three books on top of each other, spines towards the viewer."""
    from scipy.spatial.transform import Rotation

    base_m = 0.74
    for k, half_thick_m in enumerate((0.017, 0.012, 0.014)):
        half_m = (half_thick_m, 0.075 - 0.006 * k, 0.11 - 0.008 * k)
        # A quarter turn about y lays the cover (+x) up; then a little turn about z.
        turned = Rotation.from_euler("yz", (-90, rng.uniform(-14, 14)), degrees=True)
        at_m = (0.53, 0.60, base_m + half_thick_m)
        box(spec, f"stack_book_{k}", half_m, at_m, f"book_{(5, 0, 3)[k]}", turned)
        base_m += 2 * half_thick_m


def _motion(_duration_s: float, seed: int) -> HeadSway:
    """A seated head that leans across and rises: about 25 cm in half a second, up to 0.8 m/s."""
    rng = default_rng(seed)
    rest = look_at((-0.05, -0.18, 1.14), (-0.02, 1.0, 0.89))
    side = rng.choice((-1.0, 1.0))
    # Half a period of the large wave, from one turning point towards the other.
    start = -np.pi / 2 + rng.uniform(0.1, 0.5)
    # Parallax needs height, too: edges along the motion tell nothing about their depth.
    rise = rng.choice((-1.0, 1.0)) * rng.uniform(0.045, 0.055)
    lean = Wave(
        1.15,
        (side * rng.uniform(0.11, 0.122), rng.uniform(0.012, 0.025), rise),
        (rng.uniform(1.0, 2.0), -side * rng.uniform(1.5, 3.0), side * rng.uniform(1.0, 2.5)),
        (start, rng.uniform(0, 2 * np.pi), start, rng.uniform(0, 2 * np.pi), start, start),
    )
    nod = Wave(
        0.43,
        (0.004, 0.006, 0.004),
        (0.7, 0.5, 0.4),
        tuple(rng.uniform(0, 2 * np.pi, 6).tolist()),
    )
    return HeadSway(rest, (lean, nod))


SCENE = Scene(
    name="desk",
    summary="a cluttered desk top before a bookshelf and a brick wall, 0.45 to 4 m",
    mjcf=Path(__file__).with_suffix(".xml"),
    textures=_textures,
    motion=_motion,
    depth_range_m=(0.45, 4.0),
    edit=_edit,
)
SCENES = {
    "trinocular-desk": replace(
        SCENE,
        name="trinocular-desk",
        rig="trinocular",
        summary="the cluttered desk seen by three cameras on the head, 0.45 to 4 m",
    )
}
