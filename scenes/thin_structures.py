"""Hard: a yard of wire mesh, railings, cables, twigs and leaves, much of it below a pixel."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from eventsweep.scenes.parts import mesh
from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.props import cable, plant
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
    from eventsweep.scenes.textures import facades, outdoor
    from eventsweep.scenes.textures.facades import Front

    concrete = ((0.40, 0.40, 0.39), (0.62, 0.61, 0.59))
    plank = ((0.3, 0.24, 0.18), (0.64, 0.55, 0.44))
    return made(
        361,
        {
            "sky": lambda rng: outdoor.sky(128, rng),
            "ground": lambda rng: tx.plaster((900, 900), rng, concrete, relief=0.6),
            "wall": painted(0.58, (1, 0.97, 0.92), 0.1),
            "front": lambda rng: facades.facade((384, 1024), rng, Front(1, 6, (0.72, 0.68, 0.6))),
            "leaves": lambda rng: outdoor.leaves(192, rng),
            "plank": lambda rng: tx.wood((96, 384), rng, colours=plank),
            "plan": lambda rng: tx.page((360, 512), rng, lines=18),
            "bark": lambda rng: outdoor.bark(64, rng),
            "pot": lambda rng: tx.solid(96, rng, (0.46, 0.22, 0.14), (0.74, 0.48, 0.34)),
            "drum": lambda rng: tx.drum(192, rng, (0.2, 0.42, 0.6)),
            "crate": lambda rng: tx.crate(192, rng),
        },
    )


def _edit(spec: mujoco.MjSpec) -> None:
    rng = default_rng(362)
    _standing(spec)
    _railing(spec)
    bake(spec, ground="ground")
    _mesh_fence(spec)
    _bare_tree(spec, rng)
    _leaves(spec, rng)
    _overhead(spec)


def _mesh_fence(spec: mujoco.MjSpec) -> None:
    """A panel of welded wire (5 cm cells, 3 mm wire) at 1.7 m, and a chain-link fence behind."""
    across, up = np.arange(-0.6, 0.61, 0.05), np.arange(0.25, 1.46, 0.05)
    segments = [((x, 0, up[0]), (x, 0, up[-1])) for x in across]
    segments += [((across[0], 0, z), (across[-1], 0, z)) for z in up]
    mesh.sticks(spec, "panel", segments, 0.0017)
    mesh.place(spec, "panel", "panel", (-0.95, 1.75, 0), "bright", 14)
    link = []
    for k in range(-24, 60):
        for lean in (1, -1):
            start = np.array([0.09 * k, 0.0, 0.1 if lean > 0 else 1.9])
            end = start + np.array([1.8, 0, 1.8 * lean])
            link.append(_cut(start, end, 0.0, 3.4))
    mesh.sticks(spec, "link", [s for s in link if s is not None], 0.002)
    mesh.place(spec, "link", "link", (0.4, 5.6, 0), "wire", -6)
    posts = BodyBuilder(spec, "posts")
    for x, y in ((-1.53, 1.6), (-0.37, 1.9)):
        posts.rod((x, y, 0), (x, y, 1.5), 0.02, "metal")
    for k in range(3):
        at = (0.4 + 1.7 * k * np.cos(np.radians(6)), 5.6 - 1.7 * k * np.sin(np.radians(6)))
        posts.rod((*at, 0), (*at, 2.0), 0.025, "metal")


def _cut(
    start: NDArray[np.float64], end: NDArray[np.float64], low: float, high: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """The part of a segment with x between `low` and `high`, if there is one worth having."""
    way = end - start
    first, last = sorted(((low - start[0]) / way[0], (high - start[0]) / way[0]))
    first, last = max(first, 0.0), min(last, 1.0)
    return (start + first * way, start + last * way) if last > first + 0.02 else None


def _railing(spec: mujoco.MjSpec) -> None:
    """A balustrade across the right half, bars of 12 mm every 11 cm."""
    rail = BodyBuilder(spec, "railing", (0.35, 2.75, 0), 6)
    for z in (0.12, 1.0):
        rail.rod((0, 0, z), (2.6, 0, z), 0.018, "metal")
    for k in range(24):
        rail.rod((0.05 + 0.11 * k, 0, 0.12), (0.05 + 0.11 * k, 0, 1.0), 0.006, "dark")
    ladder = BodyBuilder(spec, "ladder", (-2.1, 4.6, 0), 12)
    for x in (-0.22, 0.22):
        ladder.rod((x, 0, 0), (x, 0.8, 2.6), 0.018, "yellow")
    for k in range(9):
        z = 0.25 + 0.27 * k
        ladder.rod((-0.22, 0.8 * z / 2.6, z), (0.22, 0.8 * z / 2.6, z), 0.011, "yellow")


def _bare_tree(spec: mujoco.MjSpec, rng: Generator) -> None:
    """A leafless tree: boughs that fork five times, the last ones 3 mm thick."""
    BodyBuilder(spec, "trunk", (-0.35, 4.3, 0)).drum(0.05, 0.55, (0, 0, 0.55), "bark")
    tips = [(np.array([0, 0, 1.05]), np.array([0, 0, 1.0]), 0.62)]
    for level, radius in enumerate((0.022, 0.013, 0.007, 0.004, 0.0025)):
        segments, grown = [], []
        for at, way, length in tips:
            for _ in range(3 if level < 2 else 2):
                turned = way + 0.75 * rng.standard_normal(3) + (0, 0, 0.25)
                turned /= np.linalg.norm(turned)
                end = at + turned * length * rng.uniform(0.7, 1.1)
                segments.append((at, end))
                grown.append((end, turned, 0.68 * length))
        tips = grown
        mesh.sticks(spec, f"boughs_{level}", segments, radius)
        mesh.place(spec, f"boughs_{level}", f"boughs_{level}", (-0.35, 4.3, 0), "dark")


def _leaves(spec: mujoco.MjSpec, rng: Generator) -> None:
    """A bush of single leaves, ivy on the wall, and a plant with stems like threads."""
    mesh.cards(spec, "bush", mesh.crown(rng, 700, (0.5, 0.4, 0.5), lumps=5), 0.022, rng)
    mesh.place(spec, "bush", "bush", (1.5, 3.7, 0.55), "leaves")
    ivy = rng.uniform((-2.2, -0.05, 0.2), (2.2, 0.05, 3.0), (900, 3))
    ivy = ivy[np.abs(ivy[:, 0]) < 0.4 + 0.6 * ivy[:, 2] + 0.3 * rng.standard_normal(len(ivy))]
    mesh.cards(spec, "ivy", ivy, 0.035, rng)
    mesh.place(spec, "ivy", "ivy", (1.9, 7.8, 0), "leaves")
    plant(spec, "grass", (0.62, 1.72, 0.44), 0.72, rng, leaves=14)


def _standing(spec: mujoco.MjSpec) -> None:
    """What is thick: a drum, crates, a trestle with a plan, pots."""
    at = BodyBuilder(spec, "standing")
    at.drum(0.2, 0.22, (0.62, 1.72, 0.22), "pot")
    at.drum(0.29, 0.44, (-2.6, 3.3, 0.44), "drum")
    at.box((0.3, 0.3, 0.3), (2.9, 4.6, 0.3), "crate", (0, 0, 20))
    at.box((0.25, 0.25, 0.25), (2.95, 4.65, 0.85), "crate", (0, 0, -12))
    at.box((0.7, 0.35, 0.02), (-1.1, 3.3, 0.8), "plank", (0, 0, 10))
    for x in (-1.65, -0.55):
        for y in (3.05, 3.5):
            at.rod((x, y, 0), (x + 0.08, 3.28, 0.78), 0.016, "plank")
    at.box((0.25, 0.18, 0.001), (-1.15, 3.28, 0.822), "plan", (0, 0, 16))
    for k in range(7):  # reinforcing bars that lean against the wall
        at.rod((3.0 + 0.09 * k, 7.0, 0), (2.8 + 0.12 * k, 7.85, 2.5), 0.008, "dark")
    for x in (-0.7, 0.1):  # a saw-horse with a coil of tube
        at.rod((x, 6.2, 0), (x + 0.12, 6.4, 0.8), 0.02, "plank")


def _overhead(spec: mujoco.MjSpec) -> None:
    """Cables from wall to wall, a washing line, and guy wires of a mast."""
    lines = (
        ((-4.2, 3.4, 2.4), (0, 3.2, 2.05), (4.2, 3.0, 2.5), 0.004, "cable"),
        ((-4.2, 5.0, 2.5), (0, 5.0, 2.3), (4.2, 5.2, 2.6), 0.006, "cable"),
        ((-1.4, 2.4, 1.75), (0.2, 2.3, 1.66), (1.9, 2.2, 1.78), 0.0025, "bright"),
    )
    for k, (a, b, c, radius, material) in enumerate(lines):
        cable(spec, f"line_{k}", (a, b, c), radius, material)
    mast = BodyBuilder(spec, "mast", (2.3, 6.2, 0))
    mast.rod((0, 0, 0), (0, 0, 3.4), 0.022, "metal")
    for x, y in ((-1.1, -0.6), (1.0, -0.8), (0.1, 1.1)):
        mast.rod((x, y, 0), (0, 0, 3.0), 0.003, "bright")
    for k in range(4):
        mast.rod((-0.4, 0, 2.7 + 0.2 * k), (0.4, 0, 2.7 + 0.2 * k), 0.006, "bright")
    props = BodyBuilder(spec, "line_posts")
    props.rod((-1.4, 2.4, 0), (-1.4, 2.4, 1.77), 0.014, "metal")
    props.rod((1.9, 2.2, 0), (1.9, 2.2, 1.8), 0.014, "metal")
    for k in range(5):
        x = -0.9 + 0.5 * k
        props.box((0.008, 0.012, 0.035), (x, 2.33, 1.68), "yellow")


def _motion(_duration_s: float, seed: int) -> HeadSway:
    rest = look_at((0, 0, 1.5), (0.1, 3.6, 1.1))
    return HeadSway.seeded(rest, (0.10, 0.05, 0.04), (1.5, 2.5, 2.0), (1.4, 0.7), seed)


SCENE = Scene(
    name="thin-structures",
    summary="hard: wire mesh, railings, cables, twigs and leaves in a yard, 1 to 9 m",
    mjcf=Path(__file__).with_name("yard.xml"),
    textures=_textures,
    motion=_motion,
    depth_range_m=(1.0, 9.0),
    edit=_edit,
)
