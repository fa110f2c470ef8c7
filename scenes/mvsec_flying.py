"""Twin of MVSEC indoor_flying: a drone over boxes, barrels and tarps in a large hall."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import default_rng

from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.shadows import bake
from eventsweep.scenes.parts.stock import faded, made, painted
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import HeadSway, Wave, look_at
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.parts.print import plain_carton

    concrete = ((0.34, 0.345, 0.35), (0.62, 0.62, 0.6))
    return made(
        231,
        {
            "floor": lambda rng: tx.plaster((768, 768), rng, concrete, relief=0.6),
            "wall": painted(0.6, (1, 1, 0.98), 0.06),
            "panel": lambda rng: tx.tiles(
                (512, 512), rng, 4, ((0.5, 0.52, 0.54), (0.7, 0.72, 0.72))
            ),
            "mat": lambda rng: tx.cloth((384, 384), rng, ((0.1, 0.18, 0.34), (0.3, 0.4, 0.6)), 64),
            "tarp_blue": lambda rng: tx.cloth(
                (256, 512), rng, ((0.1, 0.22, 0.42), (0.5, 0.62, 0.8))
            ),
            "tarp_green": lambda rng: tx.cloth(
                (256, 512), rng, ((0.14, 0.26, 0.16), (0.5, 0.6, 0.4))
            ),
            "crate": lambda rng: tx.crate(256, rng),
            "drum_blue": lambda rng: tx.drum(256, rng, (0.2, 0.42, 0.6)),
            "drum_rust": lambda rng: tx.drum(256, rng, (0.6, 0.42, 0.26)),
            "carton_a": faded(lambda rng: tx.carton(256, rng, (0.6, 0.3, 0.2)), 0.2),
            "carton_b": lambda rng: plain_carton(256, rng),
            "beam": lambda rng: tx.solid(
                128, rng, (0.3, 0.31, 0.33), (0.5, 0.51, 0.53), fineness=5
            ),
            "foam": lambda rng: tx.solid(128, rng, (0.3, 0.3, 0.32), (0.62, 0.6, 0.6), fineness=3),
            "banner": lambda rng: tx.label((320, 840), rng, (0.2, 0.34, 0.6)),
            "box_white": lambda rng: tx.toy_block(192, rng, (0.24, 0.3, 0.4)),
        },
    )


def _edit(spec: mujoco.MjSpec) -> None:
    _boxes(spec)
    _drums(spec)
    _tarps(spec)
    _net(spec)
    _roof(spec)
    bake(spec, floor="floor")


def _boxes(spec: mujoco.MjSpec) -> None:
    at = BodyBuilder(spec, "boxes")
    at.box((0.30, 0.28, 0.28), (-0.62, 1.72, 0.28), "carton_a", (0, 0, 24))
    at.box((0.20, 0.18, 0.17), (-0.66, 1.70, 0.73), "carton_b", (0, 0, -8))
    at.box((0.34, 0.34, 0.34), (1.55, 2.75, 0.34), "crate", (0, 0, 20))
    at.box((0.28, 0.28, 0.28), (1.60, 2.80, 0.96), "crate", (0, 0, -12))
    at.box((0.20, 0.20, 0.20), (1.56, 2.76, 1.44), "carton_b", (0, 0, 34))
    at.box((0.45, 0.34, 0.40), (0.10, 4.45, 0.40), "carton_b", (0, 0, -20))
    at.box((0.36, 0.30, 0.30), (0.16, 4.50, 1.10), "carton_a", (0, 0, 6))
    at.box((0.34, 0.34, 0.34), (-2.45, 3.60, 0.34), "crate", (0, 0, -30))
    at.box((0.26, 0.22, 0.20), (-2.45, 3.58, 0.88), "box_white", (0, 0, 10))
    at.box((0.40, 0.30, 0.26), (3.35, 3.70, 0.26), "carton_a", (0, 0, 40))
    at.box((0.22, 0.22, 0.22), (0.42, 1.75, 0.22), "box_white", (0, 0, 32))
    at.box((0.15, 0.9, 0.08), (0.35, 2.9, 0.08), "foam", (0, 0, -52))
    at.box((0.5, 0.5, 0.6), (-1.05, 5.55, 0.6), "carton_b", (0, 0, 14))


def _drums(spec: mujoco.MjSpec) -> None:
    at = BodyBuilder(spec, "drums")
    places = ((-1.55, 2.75), (-2.05, 5.0), (2.35, 3.95), (0.95, 5.5), (3.6, 5.2))
    for k, (x, y) in enumerate(places):
        at.drum(0.29, 0.44, (x, y, 0.44), ("drum_blue", "drum_rust")[k % 2], (0, 0, 50 * k))
    at.drum(0.29, 0.44, (2.72, 4.36, 0.29), "drum_blue", (90, 0, 62))
    at.drum(0.29, 0.44, (-1.98, 5.05, 1.32), "drum_rust", (0, 0, 160))
    for k, x in enumerate((-3.3, 0.75, 2.0)):  # traffic cones, as stacks of discs
        y = (4.4, 3.75, 1.95)[k]
        at.box((0.17, 0.17, 0.012), (x, y, 0.012), "red", (0, 0, 20 * k))
        for ring in range(5):
            material = "lamp" if ring == 2 else "red"
            at.drum(0.13 - 0.024 * ring, 0.045, (x, y, 0.065 + 0.09 * ring), material)


def _tarps(spec: mujoco.MjSpec) -> None:
    """Tarpaulins thrown over crates and hung on a line: strips that swing to and fro."""
    line = BodyBuilder(spec, "tarp_line", (2.05, 5.35, 0), -12)
    line.rod((-1.2, 0, 2.1), (1.2, 0, 2.1), 0.02, "beam")
    for x in (-1.2, 1.2):
        line.rod((x, 0, 0), (x, 0, 2.2), 0.03, "beam")
    for k in range(8):
        swing = 28.0 * (-1) ** k
        line.box((0.145, 0.006, 0.75), (-1.0 + 0.27 * k, 0.0, 1.33), "tarp_blue", (0, 0, swing))
    heap = BodyBuilder(spec, "tarp_heap", (-0.75, 4.25, 0), 25)
    heap.box((0.5, 0.36, 0.3), (0, 0, 0.3), "carton_b")
    heap.box((0.56, 0.42, 0.008), (0, 0, 0.612), "tarp_green")
    for k, (x, y, yaw) in enumerate(((0, -0.44, 0), (0, 0.44, 0), (-0.58, 0, 90), (0.58, 0, 90))):
        half = (0.57, 0.43)[k // 2]
        tilt = (-14.0, 14.0, 14.0, -14.0)[k]
        euler = (tilt, 0, yaw) if k < 2 else (0, tilt, 0)
        size = (half, 0.006, 0.29) if k < 2 else (0.006, half, 0.29)
        heap.box(size, (x * 1.05, y * 1.05, 0.33), "tarp_green", euler)


def _net(spec: mujoco.MjSpec) -> None:
    """The net that keeps drones in, on posts along the left side."""
    net = BodyBuilder(spec, "net", (-3.55, 0, 0))
    for y in (2.6, 4.1, 5.6):
        net.rod((0, y, 0), (0, y, 3.4), 0.035, "beam")
    for k in range(8):
        net.rod((0, 2.6, 0.25 + 0.42 * k), (0, 5.6, 0.25 + 0.42 * k), 0.008, "rope")
    for k in range(9):
        y = 2.75 + 0.33 * k
        net.rod((0, y, 0.05), (0, y, 3.3), 0.008, "rope")


def _roof(spec: mujoco.MjSpec) -> None:
    """Trusses and rows of lamps under the ceiling."""
    roof = BodyBuilder(spec, "roof")
    for y in (4.6, 6.0):
        for z in (3.55, 3.95):
            roof.rod((-5, y, z), (5, y, z), 0.03, "beam")
        for k in range(12):
            x = -4.8 + 0.8 * k
            low, high = ((3.55, 3.95), (3.95, 3.55))[k % 2]
            roof.rod((x, y, low), (x + 0.8, y, high), 0.018, "beam")
    for x in (-3.0, -1.0, 1.0, 3.0):
        roof.box((0.35, 0.12, 0.05), (x, 4.6, 3.42), "lamp")


def _motion(_duration_s: float, seed: int) -> HeadSway:
    """A quadrotor: it slides and climbs at up to 0.9 m/s, and leans into what it does."""
    rng = default_rng(seed)
    rest = look_at((0, 0, 1.25), (0.1, 4.0, 0.78))
    side = float(rng.choice((-1.0, 1.0)))
    start = float(-np.pi / 2 + rng.uniform(0.5, 0.8))
    slide = Wave(
        2.6,
        (side * float(rng.uniform(0.2, 0.24)), float(rng.uniform(-0.06, 0.06)), 0.1),
        (0.8, 1.0, -side * 2.0),
        (start, start, *rng.uniform(0, 2 * np.pi, 3).tolist(), start),
    )
    hum = Wave(
        0.35, (0.002, 0.003, 0.002), (0.12, 0.08, 0.12), tuple(rng.uniform(0, 6, 6).tolist())
    )
    return HeadSway(rest, (slide, hum))


SCENE = Scene(
    name="mvsec-flying",
    summary="boxes, barrels and tarps in a hall, seen from a drone, 1 to 6.5 m",
    mjcf=Path(__file__).with_name("hall.xml"),
    textures=_textures,
    motion=_motion,
    depth_range_m=(1.0, 6.5),
    rig="mvsec",
    duration_s=1.0,
    edit=_edit,
)
