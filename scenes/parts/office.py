"""The laboratory office of the twins of rpg_eccv18: its surfaces, its furniture, its cases."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import default_rng

from eventsweep.scenes.parts import furniture as fu
from eventsweep.scenes.parts.furniture import BodyBuilder, bin_, chair, shelf
from eventsweep.scenes.parts.props import plant
from eventsweep.scenes.parts.shadows import bake
from eventsweep.scenes.parts.stock import made, stock
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import HeadSway, Vector3, Wave, look_at
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image


def _by_hand(eye_m: Vector3, target_m: Vector3, _duration_s: float, seed: int) -> HeadSway:
    """A rig waved by hand: about 25 cm to and fro at 0.45 m/s, with 20 to 30 degrees a second."""
    rng = default_rng(seed)
    side = float(rng.choice((-1.0, 1.0)))
    start = float(-np.pi / 2 + rng.uniform(0.1, 0.4))
    sway = Wave(
        float(rng.uniform(1.5, 1.7)),
        (side * float(rng.uniform(0.1, 0.12)), float(rng.uniform(0.03, 0.06)), 0.03),
        (2.0, -side * float(rng.uniform(2.0, 4.0)), 3.0),
        (start, float(rng.uniform(0, 6)), *rng.uniform(0, 2 * np.pi, 2).tolist(), start, 0.0),
    )
    tremor = Wave(0.6, (0.006, 0.006, 0.004), (0.6, 0.5, 0.7), tuple(rng.uniform(0, 6, 6).tolist()))
    return HeadSway(look_at(eye_m, target_m), (sway, tremor))


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.parts.print import whiteboard

    carpet = ((0.22, 0.24, 0.28), (0.44, 0.46, 0.5))
    sofa = ((0.30, 0.12, 0.12), (0.56, 0.3, 0.27))
    denim = ((0.12, 0.17, 0.28), (0.34, 0.42, 0.56))
    room = {
        "carpet": lambda rng: tx.plaster((512, 512), rng, carpet, relief=0.7),
        "whiteboard": lambda rng: whiteboard((480, 768), rng),
        "toy": lambda rng: tx.toy_block(160, rng, (0.2, 0.3, 0.5)),
        "crate": lambda rng: tx.crate(256, rng),
        "drum": lambda rng: tx.can(192, rng, (0.5, 0.3, 0.16)),
        "sofa": lambda rng: tx.cloth((256, 256), rng, sofa, threads=48),
        "skin": lambda rng: tx.solid(128, rng, (0.56, 0.42, 0.34), (0.76, 0.6, 0.5), fineness=1.5),
        "hair": lambda rng: tx.solid(128, rng, (0.1, 0.08, 0.06), (0.34, 0.26, 0.18), bands=14),
        "shirt": lambda rng: tx.solid(128, rng, (0.3, 0.36, 0.46), (0.72, 0.76, 0.8), bands=11),
        "jeans": lambda rng: tx.solid(128, rng, *denim, fineness=4.0),
        "cover": lambda rng: tx.poster((384, 272), rng, (0.46, 0.2, 0.18), (0.86, 0.74, 0.4)),
        "sky": lambda rng: tx.finish(
            tx.blend(tx.fractal((256, 256), rng, 1.8), (0.74, 0.8, 0.9), (0.98, 0.98, 0.98))
        ),
    }
    return {**stock(221), **made(222, room)}


def _edit(spec: mujoco.MjSpec) -> None:
    rng = default_rng(223)
    _monitor_corner(spec)
    _reader_corner(spec)
    _boxes_corner(spec)
    bin_(spec, "bin", (-0.34, 1.42, 0))
    _beside_the_bin(spec)
    chair(spec, "spare_chair", (-0.9, 3.9, 0), 150)
    shelf(spec, "shelf", (-0.9, 5.2, 0), (0.7, 0.3, 0.9), 2, rng, 0.8)
    plant(spec, "plant", (2.0, 4.75, 0.4), 0.8, rng, leaves=7)
    bake(spec, floor="carpet")


def _monitor_corner(spec: mujoco.MjSpec) -> None:
    """A work place at the left: monitor, keyboard, mug, papers, a lamp."""
    fu.table(spec, "desk", (-2.0, 1.7, 0), (1.6, 0.76, 0.74))
    fu.monitor(spec, "monitor", (-2.02, 1.86, 0.74), 8, 0.56)
    fu.keyboard(spec, "keys", (-2.0, 1.55, 0.74), -4)
    fu.mug(spec, "mug", (-1.58, 1.66, 0.74), 30)
    fu.desk_lamp(spec, "lamp", (-2.52, 1.92, 0.74))
    at = fu.BodyBuilder(spec, "papers", (-2.0, 1.7, 0.74))
    at.box((0.105, 0.148, 0.0008), (-0.42, -0.16, 0.001), "page_a", (0, 0, 12))
    at.box((0.105, 0.148, 0.02), (0.52, 0.14, 0.02), "book_3", (0, 0, -14))
    at.box((0.095, 0.13, 0.015), (0.53, 0.15, 0.055), "book_2", (0, 0, 6))
    at.ball((0.045, 0.045, 0.045), (0.33, -0.2, 0.045), "ball", (60, 10, 0))
    at.drum(0.035, 0.058, (0.62, -0.16, 0.058), "can")


def _reader_corner(spec: mujoco.MjSpec) -> None:
    fu.chair(spec, "reader_chair", (1.55, 2.66, 0))
    _reader(spec, "reader", (1.55, 2.62, 0), -8)
    fu.table(spec, "table", (1.55, 1.72, 0), (1.3, 0.72, 0.72))
    fu.mug(spec, "table_mug", (1.96, 1.62, 0.72), 60)
    at = fu.BodyBuilder(spec, "table_things", (1.55, 1.72, 0.72))
    at.box((0.11, 0.08, 0.06), (-0.42, 0.12, 0.06), "carton_a", (0, 0, 20))
    at.box((0.105, 0.148, 0.018), (0.36, -0.16, 0.018), "book_0", (0, 0, -20))
    at.box((0.105, 0.148, 0.0008), (-0.1, -0.18, 0.001), "page_b", (0, 0, 8))
    at.drum(0.034, 0.058, (-0.5, -0.14, 0.058), "can")


def _boxes_corner(spec: mujoco.MjSpec) -> None:
    """Boxes on the floor in the middle of the room."""
    at = BodyBuilder(spec, "boxes")
    at.box((0.24, 0.20, 0.20), (0.10, 2.45, 0.20), "carton_a", (0, 0, 22))
    at.box((0.17, 0.15, 0.14), (0.12, 2.47, 0.54), "carton_b", (0, 0, -14))
    at.box((0.10, 0.10, 0.10), (0.10, 2.44, 0.78), "toy", (0, 0, 30))
    at.box((0.28, 0.28, 0.28), (-0.55, 3.15, 0.28), "crate", (0, 0, -18))
    at.box((0.15, 0.13, 0.12), (-0.52, 3.12, 0.68), "carton_a", (0, 0, 12))
    at.box((0.22, 0.18, 0.16), (0.62, 3.25, 0.16), "carton_b", (0, 0, 8))
    at.box((0.12, 0.12, 0.12), (-0.10, 1.95, 0.12), "toy", (0, 0, -20))
    at.drum(0.15, 0.2, (0.58, 2.15, 0.2), "drum", (0, 0, 15))


def _beside_the_bin(spec: mujoco.MjSpec) -> None:
    at = BodyBuilder(spec, "litter")
    at.ball((0.05, 0.045, 0.04), (-0.1, 1.16, 0.04), "white", (20, 30, 0))
    at.ball((0.045, 0.05, 0.038), (-0.62, 1.24, 0.038), "white", (50, 10, 70))
    at.box((0.105, 0.148, 0.0008), (0.06, 1.42, 0.001), "page_a", (0, 0, 35))


def _reader(spec: mujoco.MjSpec, name: str, at_m: fu.Point, yaw_deg: float = 0) -> None:
    """Seats a person who faces -y on a chair at `at_m` and reads a book on a table before it.

    Args:
        spec: edited in place; needs the materials of stock.xml, `skin`, `hair`, `shirt`, `jeans`.
        name: prefix of the geoms' names.
        at_m: on the floor, under the hips, m.
        yaw_deg: turns the whole person about z.
    """
    group = BodyBuilder(spec, name, at_m, yaw_deg)
    _trunk(group)
    _head(group)
    for side in (-1.0, 1.0):
        _limbs(group, side)
    _book(group)


def _trunk(group: BodyBuilder) -> None:
    group.ball((0.18, 0.13, 0.13), (0, 0.0, 0.56), "jeans")
    group.ball((0.165, 0.115, 0.2), (0, -0.01, 0.76), "shirt", (6, 0, 0))
    group.ball((0.2, 0.12, 0.17), (0, -0.05, 0.96), "shirt", (10, 0, 0))
    group.rod((-0.15, -0.06, 1.05), (0.15, -0.06, 1.05), 0.06, "shirt")


def _head(group: BodyBuilder) -> None:
    """A head bent over the book."""
    group.rod((0, -0.06, 1.08), (0, -0.1, 1.18), 0.05, "skin")
    group.ball((0.078, 0.1, 0.115), (0, -0.14, 1.26), "skin", (22, 0, 0))
    group.ball((0.09, 0.1, 0.085), (0, -0.112, 1.318), "hair", (22, 0, 0))
    group.ball((0.088, 0.07, 0.1), (0, -0.08, 1.28), "hair", (22, 0, 0))
    group.ball((0.014, 0.02, 0.022), (0, -0.245, 1.235), "skin", (22, 0, 0))
    for side in (-1.0, 1.0):
        group.ball((0.012, 0.02, 0.03), (0.08 * side, -0.13, 1.25), "skin")
        group.ball((0.012, 0.006, 0.007), (0.034 * side, -0.228, 1.262), "ink", (22, 0, 0))
        group.rod((0.018 * side, -0.232, 1.282), (0.05 * side, -0.226, 1.282), 0.004, "hair")


def _limbs(group: BodyBuilder, side: float) -> None:
    shoulder, elbow = (0.2 * side, -0.06, 1.03), (0.27 * side, -0.24, 0.81)
    hand = (0.15 * side, -0.44, 0.89)
    group.rod(shoulder, elbow, 0.05, "shirt")
    group.rod(elbow, hand, 0.038, "shirt")
    group.ball((0.035, 0.055, 0.028), (0.14 * side, -0.47, 0.91), "skin", (30, 0, 20 * side))
    knee, foot = (0.12 * side, -0.42, 0.52), (0.12 * side, -0.4, 0.08)
    group.rod((0.1 * side, 0, 0.52), knee, 0.075, "jeans")
    group.rod(knee, foot, 0.055, "jeans")
    group.ball((0.045, 0.12, 0.04), (0.12 * side, -0.46, 0.04), "dark")


def _book(group: BodyBuilder) -> None:
    """An open book, held up at an angle, its cover to whoever looks at the reader."""
    for side in (-1.0, 1.0):
        group.box((0.088, 0.006, 0.12), (0.085 * side, -0.5, 0.97), "cover", (28, 0, 9 * side))
        group.box((0.084, 0.004, 0.115), (0.083 * side, -0.49, 0.975), "page_a", (28, 0, 9 * side))
    group.box((0.01, 0.005, 0.12), (0, -0.514, 0.968), "cover", (28, 0, 0))


SCENES = {
    name: Scene(
        name=name,
        summary=f"{shown}, 0.5 to 6 m",
        mjcf=Path(__file__).parents[1] / "office.xml",
        textures=_textures,
        motion=partial(_by_hand, eye_m, target_m),
        depth_range_m=(0.5, 6.0),
        rig="rpg",
        duration_s=1.0,
        edit=_edit,
    )
    for name, shown, eye_m, target_m in (
        ("rpg-bin", "a waste-paper bin and what missed it", (-0.4, 0.62, 1.0), (-0.3, 1.75, 0.42)),
        ("rpg-boxes", "boxes on an office floor before a sofa and a whiteboard",
         (0.15, 0.75, 1.3), (0.05, 2.8, 0.75)),
        ("rpg-monitor", "a monitor on a desk, the office behind it",
         (-1.92, 0.92, 1.18), (-1.85, 2.0, 0.95)),
        ("rpg-reader", "somebody reading at a table in an office",
         (1.38, 0.86, 1.2), (1.52, 2.4, 1.02)),
    )
}  # fmt: skip
"""The twins of that data set: a rig held by hand at a place that looks at another."""
