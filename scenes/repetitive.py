"""Hard: a garden in which everything repeats: pickets, checker, bricks, slats, pots."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import default_rng

from eventsweep.scenes.parts import mesh
from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.props import plant
from eventsweep.scenes.parts.shadows import bake
from eventsweep.scenes.parts.stock import made
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Field, Image

_PICKET_M = ((-0.042, 0.05), (0.042, 0.05), (0.042, 0.92), (0.0, 1.0), (-0.042, 0.92))


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.textures import facades, outdoor

    plank = ((0.62, 0.6, 0.56), (0.82, 0.8, 0.76))
    return made(
        351,
        {
            "sky": lambda rng: outdoor.sky(128, rng),
            "checker": lambda rng: facades.checker((1120, 960), rng, 16),
            "brick": lambda rng: tx.bricks((512, 512), rng, 16, 6),
            "boards": lambda rng: facades.picket_row((256, 512), rng, 16),
            "plank": lambda rng: tx.wood((256, 64), rng, colours=plank),
            "louvre": lambda rng: tx.finish(
                _slats(256) * (0.9 + 0.2 * tx.fractal((256, 256), rng)[..., None])
            ),
            "leaves": lambda rng: outdoor.leaves(128, rng),
            "tiles": lambda rng: tx.tiles((256, 256), rng, 8, plank),
            "pot": lambda rng: tx.solid(96, rng, (0.5, 0.26, 0.18), (0.66, 0.42, 0.3), fineness=4),
            "leaf": lambda rng: tx.solid(96, rng, (0.12, 0.28, 0.12), (0.42, 0.62, 0.3), bands=4),
        },
    )


def _slats(size_px: int) -> Field:
    """A shutter: sloping slats in a frame, as reflectance."""
    down, across = np.mgrid[0:size_px, 0:size_px] / size_px
    slat = 0.25 + 0.5 * ((down * 18) % 1.0)
    rim = (np.minimum(down, 1 - down) < 0.05) | (np.abs(across - 0.5) > 0.42)
    tone = np.where(rim, 0.72, slat)[..., None]
    return np.asarray(tone * np.array([0.7, 0.95, 0.8]), np.float32)


def _edit(spec: mujoco.MjSpec) -> None:
    _walls(spec)
    _fences(spec)
    _rows(spec)
    bake(spec, checker="checker")


def _walls(spec: mujoco.MjSpec) -> None:
    """A brick house at the back with shutters, a board fence at both sides."""
    at = BodyBuilder(spec, "walls")
    at.box((3.6, 0.1, 1.7), (0, 7.2, 1.7), "brick")
    for k in range(4):
        x = -2.3 + 1.5 * k
        at.box((0.4, 0.02, 0.5), (x, 7.08, 1.7), "louvre")
        at.box((0.46, 0.04, 0.03), (x, 7.08, 1.17), "plank")
    for side in (-1, 1):
        at.box((0.03, 4.2, 0.9), (side * 3.5, 3.4, 0.9), "boards")
    at.box((3.7, 0.3, 0.05), (0, 7.0, 3.45), "plank")


def _fences(spec: mujoco.MjSpec) -> None:
    """Two picket fences across the view, one behind the other."""
    mesh.prism(spec, "picket", _PICKET_M, 0.011)
    for row, (y, x0, count, yaw) in enumerate(((2.6, -2.6, 22, 8.0), (4.9, -2.9, 38, -5.0))):
        fence = BodyBuilder(spec, f"fence_{row}", (x0, y, 0), yaw)
        length = 0.155 * count
        for z in (0.3, 0.75):
            fence.box((length / 2, 0.018, 0.035), (length / 2 - 0.08, 0.03, z), "plank")
        body = spec.body(f"fence_{row}")
        for k in range(count):
            mesh.place(spec, "picket", f"picket_{row}_{k}", (0.155 * k, 0, 0), "plank", 0, body)


def _rows(spec: mujoco.MjSpec) -> None:
    """Pots in a row, posts in a row, slats of a pergola overhead."""
    rng = default_rng(352)
    at = BodyBuilder(spec, "rows")
    for k in range(6):
        x = -1.9 + 0.76 * k
        at.drum(0.16, 0.15, (x, 6.4, 0.15), "pot")
        at.drum(0.185, 0.03, (x, 6.4, 0.3), "pot")
        plant(spec, f"plant_{k}", (x, 6.4, 0.32), 0.55, rng, leaves=6)
    for k in range(5):
        at.drum(0.09, 0.1, (1.2 + 0.26 * k, 1.9 + 0.16 * k, 0.1), "pot")
    for k in range(11):
        at.box((2.6, 0.03, 0.07), (0, 2.2 + 0.4 * k, 2.75), "plank")
    for x in (-2.4, 2.4):
        at.box((0.05, 2.2, 0.07), (x, 4.2, 2.62), "plank")
        for y in (2.2, 6.2):
            at.box((0.05, 0.05, 1.3), (x, y, 1.3), "plank")


def _motion(_duration_s: float, seed: int) -> HeadSway:
    rest = look_at((0, 0, 1.45), (0.05, 3.6, 0.95))
    return HeadSway.seeded(rest, (0.11, 0.04, 0.04), (1.5, 2.5, 2.0), (1.4, 0.7), seed)


SCENE = Scene(
    name="repetitive",
    summary="hard: a garden of picket fences, checker and bricks, 1.5 to 8 m",
    mjcf=Path(__file__).with_name("patio.xml"),
    textures=_textures,
    motion=_motion,
    depth_range_m=(1.5, 8.0),
    edit=_edit,
)
