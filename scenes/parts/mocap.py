"""The motion-capture room of the twins of TUM-VIE: its surfaces, its furniture, its cases."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.random import Generator, default_rng

from eventsweep.scenes.parts import furniture as fu
from eventsweep.scenes.parts.heads import centred
from eventsweep.scenes.parts.props import cable, plant
from eventsweep.scenes.parts.shadows import bake
from eventsweep.scenes.parts.stock import made, painted, stock
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.parts.print import apriltags, whiteboard

    carpet = ((0.25, 0.26, 0.28), (0.33, 0.34, 0.36))
    room = {
        "carpet": lambda rng: tx.plaster((768, 768), rng, carpet, relief=0.5),
        "grid": lambda rng: apriltags(432, rng),
        "whiteboard": lambda rng: whiteboard((560, 880), rng),
        "poster_c": lambda rng: tx.poster((560, 400), rng, (0.2, 0.42, 0.34), (0.88, 0.78, 0.4)),
        "mat": painted(0.34, (0.7, 0.85, 1.0), 0.03),
        "foam": lambda rng: tx.solid(96, rng, (0.5, 0.5, 0.52), (0.6, 0.6, 0.62), fineness=5.0),
    }
    return {**stock(211), **made(212, room)}


def _edit(spec: mujoco.MjSpec) -> None:
    rng = default_rng(213)
    _near_table(spec)
    _second_desk(spec, rng)
    _left_desk(spec)
    _floor(spec)
    _tripods(spec)
    plant(spec, "plant", (-2.25, 3.35, 0.42), 0.75, rng, leaves=8)
    bake(spec, floor="carpet", near_0="beech")


def _near_table(spec: mujoco.MjSpec) -> None:
    """What stands within reach of a head at the origin; the top lies at 0.76 m."""
    fu.table(spec, "near", (-0.15, 0.72, 0), (1.5, 0.74, 0.76))
    things = fu.BodyBuilder(spec, "near_things", (0, 0, 0.76))
    things.box((0.13, 0.10, 0.09), (-0.56, 0.78, 0.09), "carton_a", (0, 0, 24))
    things.box((0.09, 0.07, 0.06), (-0.55, 0.79, 0.24), "carton_b", (0, 0, -12))
    things.ball((0.075, 0.075, 0.075), (0.22, 0.92, 0.075), "ball", (60, 20, 0))
    things.box((0.105, 0.148, 0.0008), (-0.22, 0.58, 0.001), "page_a", (0, 0, 16))
    things.box((0.105, 0.148, 0.0008), (-0.17, 0.54, 0.0026), "page_b", (0, 0, -7))
    things.rod((-0.28, 0.52, 0.007), (-0.16, 0.6, 0.007), 0.0045, "red")
    things.drum(0.045, 0.06, (0.42, 0.62, 0.06), "can", (0, 0, 20))
    things.box((0.075, 0.11, 0.016), (0.40, 0.86, 0.016), "book_2", (0, 0, 10))
    for k, material in enumerate(("book_0", "book_4", "book_5")):
        things.box((0.015, 0.075, 0.105 - 0.006 * k), (-0.20 + 0.034 * k, 0.98, 0.105), material)
    things.box((0.02, 0.02, 0.06), (0.05, 0.60, 0.06), "foam")
    things.ball((0.012, 0.012, 0.012), (0.05, 0.60, 0.132), "bright")
    fu.mug(spec, "near_mug", (-0.02, 0.80, 0.76), 150)
    things.rod((0.18, 0.56, 0.012), (0.30, 0.76, 0.012), 0.007, "dark")
    things.rod((0.20, 0.82, 0.012), (0.40, 0.70, 0.012), 0.007, "dark")
    for k in range(5):  # the markers of a motion-capture system's wand
        things.ball((0.011, 0.011, 0.011), (0.20 + 0.05 * k, 0.82 - 0.03 * k, 0.028), "bright")
    cord = [(0.48, 0.45, 0.765), (0.3, 0.5, 0.765), (0.26, 0.7, 0.765), (0.08, 0.74, 0.765)]
    cable(spec, "near_cord", cord, 0.0032, "cord")


def _second_desk(spec: mujoco.MjSpec, rng: Generator) -> None:
    """A work place at the right, for the case that looks at desks."""
    fu.table(spec, "second", (1.62, 1.55, 0), (1.5, 0.72, 0.74), -18)
    at = fu.BodyBuilder(spec, "second_things", (1.62, 1.55, 0.74), -18)
    fu.monitor(spec, "second_left", (1.40, 1.78, 0.74), -4)
    fu.monitor(spec, "second_right", (2.00, 1.60, 0.74), -38)
    fu.keyboard(spec, "second_keys", (1.52, 1.34, 0.74), -20)
    fu.mug(spec, "second_mug", (1.04, 1.52, 0.74), 40)
    at.box((0.105, 0.148, 0.0008), (-0.52, -0.16, 0.001), "page_b", (0, 0, 9))
    at.box((0.09, 0.06, 0.05), (-0.60, 0.18, 0.05), "carton_b", (0, 0, 30))
    at.box((0.105, 0.148, 0.02), (0.45, -0.16, 0.02), "book_3", (0, 90, 12))
    fu.chair(spec, "second_chair", (2.2, 0.95, 0), 150)
    fu.shelf(spec, "shelf", (1.05, 3.48, 0), (0.9, 0.3, 1.0), 3, rng, 0.8)


def _left_desk(spec: mujoco.MjSpec) -> None:
    fu.table(spec, "left", (-1.65, 2.0, 0), (1.3, 0.66, 0.74), 32)
    fu.monitor(spec, "left_monitor", (-1.72, 2.12, 0.74), 30, 0.6)
    fu.keyboard(spec, "left_keys", (-1.55, 1.86, 0.74), 28)
    fu.chair(spec, "left_chair", (-1.05, 1.72, 0), 205)
    at = fu.BodyBuilder(spec, "left_things", (-1.65, 2.0, 0.74), 32)
    at.drum(0.038, 0.05, (0.42, 0.1, 0.05), "pot")
    for k, lean in enumerate((-0.03, 0.025)):
        material = ("yellow", "blue")[k]
        at.rod((0.42, 0.1, 0.06), (0.42 + lean, 0.1 + 0.02 * k, 0.18), 0.004, material)
    at.box((0.105, 0.148, 0.0008), (0.36, -0.14, 0.001), "page_a", (0, 0, -14))


def _floor(spec: mujoco.MjSpec) -> None:
    """Cartons, a ball, a planter and a bag, 1.6 to 3.4 m away."""
    at = fu.BodyBuilder(spec, "stack")
    at.box((0.26, 0.22, 0.21), (0.62, 2.72, 0.21), "carton_a", (0, 0, -14))
    at.box((0.20, 0.17, 0.16), (0.62, 2.72, 0.58), "carton_b", (0, 0, 10))
    at.box((0.13, 0.11, 0.10), (0.59, 2.70, 0.84), "carton_a", (0, 0, -33))
    at.box((0.24, 0.20, 0.18), (-0.62, 3.3, 0.18), "carton_b", (0, 0, 18))
    at.box((0.17, 0.15, 0.14), (-0.60, 3.28, 0.50), "carton_a", (0, 0, -8))
    at.ball((0.19, 0.19, 0.19), (0.22, 1.72, 0.21), "ball", (70, 25, 10))
    at.drum(0.17, 0.2, (-2.25, 3.35, 0.2), "pot")
    at.box((0.28, 0.16, 0.16), (-0.3, 2.5, 0.16), "cloth", (0, 0, -22))
    at.rod((-0.5, 2.5, 0.31), (-0.1, 2.42, 0.31), 0.02, "dark")


def _tripods(spec: mujoco.MjSpec) -> None:
    fu.tripod(spec, "tripod_a", (-0.42, 2.0, 0), 1.32, 14)
    fu.tripod(spec, "tripod_b", (1.52, 2.95, 0), 1.7, -28)
    fu.tripod(spec, "tripod_c", (-1.2, 3.1, 0), 1.75, 22)
    for k, x in enumerate((-1.3, 1.5)):
        camera = fu.BodyBuilder(spec, f"truss_camera_{k}", (x, 3.40, 2.36), -8 * x)
        camera.box((0.05, 0.06, 0.05), (0, 0, 0), "dark", (-25, 0, 0))
        camera.drum(0.046, 0.01, (0, -0.064, -0.03), "metal", (65, 0, 0))
        camera.rod((0, 0.04, 0.02), (0, 0.05, 0.1), 0.012, "metal")


SCENES = {
    name: Scene(
        name=name,
        summary=f"{shown}, 0.45 to 4 m",
        mjcf=Path(__file__).parents[1] / "mocap.xml",
        textures=_textures,
        motion=partial(centred, style, eye_m, target_m),
        depth_range_m=(0.45, 4.0),
        rig="tumvie-kb4",
        edit=_edit,
    )
    for name, shown, style, eye_m, target_m in (
        ("tumvie-1d", "a motion-capture room, translation along one axis",
         "translate_1d", (0.1, 0.14, 1.22), (-0.15, 2.2, 0.92)),
        ("tumvie-3d", "a motion-capture room, translation along three axes",
         "translate_3d", (-0.1, 0.08, 1.24), (0.1, 2.2, 0.92)),
        ("tumvie-6dof", "a motion-capture room, six-DoF head motion",
         "six_dof", (0, 0.08, 1.22), (0.05, 2.0, 0.88)),
        ("tumvie-desk2", "desks with monitors in a motion-capture room",
         "six_dof", (0.82, 0.72, 1.2), (1.62, 2.2, 0.96)),
    )
}  # fmt: skip
"""The twins of mocap-1d-trans, mocap-3d-trans, mocap-6dof and mocap-desk2: only motions differ."""
