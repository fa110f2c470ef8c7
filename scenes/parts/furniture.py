"""Furniture made of boxes, rods and balls: what rooms, offices and halls are full of.

Everything stands on its own origin, faces -y and is turned about z; sizes are metres.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from eventsweep.scenes.parts.props import book_row, geom_type

if TYPE_CHECKING:
    import mujoco

Point = tuple[float, float, float]


class BodyBuilder:
    """A body of the scene that geoms are added to, in its own frame."""

    def __init__(
        self, spec: mujoco.MjSpec, name: str, at_m: ArrayLike = (0, 0, 0), yaw_deg: float = 0.0
    ) -> None:
        """Puts an empty body at `at_m` (3,), m, turned about z."""
        half = np.radians(yaw_deg) / 2
        quat = [np.cos(half), 0, 0, np.sin(half)]
        self.name = name
        self._body = spec.worldbody.add_body(name=name, pos=np.asarray(at_m, float), quat=quat)
        self._count = 0

    def box(self, half_m: Point, at_m: Point, material: str, euler_deg: Point = (0, 0, 0)) -> None:
        """Adds a box of half sizes `half_m` around `at_m`."""
        self._add("BOX", material, size=half_m, pos=at_m, euler=euler_deg)

    def drum(
        self,
        radius_m: float,
        half_m: float,
        at_m: Point,
        material: str,
        euler_deg: Point = (0, 0, 0),
    ) -> None:
        """Adds a cylinder of half height `half_m` around `at_m`."""
        self._add("CYLINDER", material, size=(radius_m, half_m, 0), pos=at_m, euler=euler_deg)

    def ball(self, half_m: Point, at_m: Point, material: str, euler_deg: Point = (0, 0, 0)) -> None:
        """Adds an ellipsoid of half axes `half_m` around `at_m`."""
        self._add("ELLIPSOID", material, size=half_m, pos=at_m, euler=euler_deg)

    def rod(self, a: Point, b: Point, radius_m: float, material: str) -> None:
        """Adds a rod with round ends between two points."""
        self._add("CAPSULE", material, size=(radius_m, 0, 0), fromto=(*a, *b))

    def _add(self, kind: str, material: str, **where: Any) -> None:
        euler = where.pop("euler", None)
        if euler is not None and any(euler):
            x, y, z, w = Rotation.from_euler("xyz", euler, degrees=True).as_quat()
            where["quat"] = [w, x, y, z]
        name = f"{self.name}_{self._count}"
        self._body.add_geom(name=name, type=geom_type(kind), material=material, **where)
        self._count += 1


def table(
    spec: mujoco.MjSpec,
    name: str,
    at_m: Point,
    size_m: Point,
    yaw_deg: float = 0,
    top: str = "beech",
) -> None:
    """Stands a table of width, depth and height; its top is the geom `{name}_0`."""
    half_x, half_y, height = size_m[0] / 2, size_m[1] / 2, size_m[2]
    group = BodyBuilder(spec, name, at_m, yaw_deg)
    group.box((half_x, half_y, 0.014), (0, 0, height - 0.014), top)
    for x in (0.05 - half_x, half_x - 0.05):
        for y in (0.06 - half_y, half_y - 0.06):
            group.box((0.022, 0.022, height / 2 - 0.014), (x, y, height / 2 - 0.014), "metal")


def monitor(
    spec: mujoco.MjSpec, name: str, at_m: Point, yaw_deg: float = 0, width_m: float = 0.54
) -> None:
    """Stands a monitor; `at_m` is under its screen."""
    group, half = BodyBuilder(spec, name, at_m, yaw_deg), width_m / 2
    group.drum(0.1, 0.006, (0, 0.05, 0.006), "plastic")
    group.box((0.02, 0.012, 0.12), (0, 0.055, 0.12), "plastic")
    group.box((half, 0.014, 0.6 * half), (0, 0.015, 0.12 + 0.6 * half), "dark")
    group.box((half - 0.012, 0.001, 0.56 * half), (0, 0, 0.12 + 0.6 * half), "screen")


def keyboard(
    spec: mujoco.MjSpec, name: str, at_m: Point, yaw_deg: float = 0, mouse: bool = True
) -> None:
    """Lays down a keyboard, with a mouse at its right."""
    group = BodyBuilder(spec, name, at_m, yaw_deg)
    group.box((0.205, 0.066, 0.008), (0, 0, 0.008), "plastic")
    group.box((0.2, 0.062, 0.003), (0, 0, 0.019), "keys")
    if mouse:
        group.ball((0.03, 0.05, 0.019), (0.28, 0.01, 0.016), "dark", (0, 0, 8))


def mug(spec: mujoco.MjSpec, name: str, at_m: Point, yaw_deg: float = 0) -> None:
    """Stands a mug of coffee with its handle along +x."""
    group = BodyBuilder(spec, name, at_m, yaw_deg)
    group.drum(0.041, 0.048, (0, 0, 0.048), "mug")
    group.drum(0.036, 0.0006, (0, 0, 0.0964), "coffee")
    ring = [(0.04, 0, 0.078), (0.066, 0, 0.072), (0.068, 0, 0.044), (0.04, 0, 0.024)]
    for a, b in pairwise(ring):
        group.rod(a, b, 0.006, "mug")


def chair(spec: mujoco.MjSpec, name: str, at_m: Point, yaw_deg: float = 0) -> None:
    """Rolls in an office chair; who sits on it looks to -y."""
    group = BodyBuilder(spec, name, at_m, yaw_deg)
    group.box((0.23, 0.22, 0.035), (0, 0, 0.46), "cloth")
    group.box((0.21, 0.028, 0.27), (0, 0.22, 0.82), "cloth", (-8, 0, 0))
    group.rod((0, 0.2, 0.47), (0, 0.25, 0.62), 0.02, "dark")
    group.drum(0.028, 0.16, (0, 0, 0.27), "metal")
    for x in (-0.27, 0.27):
        group.rod((x, 0.1, 0.66), (x, -0.12, 0.66), 0.02, "dark")
        group.rod((x, 0.05, 0.66), (0.8 * x, 0.02, 0.46), 0.013, "dark")
    for turn in np.radians(np.arange(5) * 72 + 20):
        foot = (0.3 * float(np.cos(turn)), 0.3 * float(np.sin(turn)), 0.06)
        group.rod((0, 0, 0.11), foot, 0.018, "dark")


def shelf(
    spec: mujoco.MjSpec,
    name: str,
    at_m: Point,
    size_m: Point,
    boards: int,
    rng: Generator,
    fill: float = 0.7,
    material: str = "oak",
) -> None:
    """Stands a bookshelf of width, depth and height, unturned, filled with books to `fill`."""
    half_x, half_y, height = size_m[0] / 2, size_m[1] / 2, size_m[2]
    group = BodyBuilder(spec, name, at_m)
    for x in (-half_x, half_x):
        group.box((0.012, half_y, height / 2), (x, 0, height / 2), material)
    pitch = (height - 0.1) / boards
    for board in range(boards + 1):
        z = 0.08 + board * pitch
        group.box((half_x, half_y, 0.012), (0, 0, z), material)
        if board < boards and rng.random() < 0.9:
            width = fill * size_m[0] * float(rng.uniform(0.5, 1.0))
            left = at_m[0] - half_x + 0.02 + float(rng.uniform(0, size_m[0] - width - 0.06))
            row = (left, at_m[1] - half_y + 0.02, at_m[2] + z + 0.012)
            tall = (0.62 * pitch, min(0.9 * pitch, 0.31))
            book_row(spec, f"{name}_book_{board}", row, width, tall, rng, 0.7 * half_y)


def tripod(
    spec: mujoco.MjSpec, name: str, at_m: Point, height_m: float, yaw_deg: float = 0
) -> None:
    """Stands a tripod with a motion-capture camera that looks to -y and a little down."""
    group = BodyBuilder(spec, name, at_m, yaw_deg)
    group.rod((0, 0, 0.55 * height_m), (0, 0, height_m), 0.014, "metal")
    for turn in np.radians((90, 210, 330)):
        reach = 0.3 * height_m
        foot = (reach * float(np.cos(turn)), reach * float(np.sin(turn)), 0.01)
        group.rod((0, 0, 0.62 * height_m), foot, 0.012, "dark")
        inner = (0.5 * foot[0], 0.5 * foot[1], 0.33 * height_m)
        group.rod((0, 0, 0.4 * height_m), inner, 0.006, "metal")
    group.box((0.05, 0.06, 0.05), (0, 0, height_m + 0.05), "dark", (-15, 0, 0))
    group.drum(0.045, 0.012, (0, -0.068, height_m + 0.034), "metal", (75, 0, 0))


def bin_(spec: mujoco.MjSpec, name: str, at_m: Point, material: str = "plastic") -> None:
    """Stands a waste-paper bin of twelve staves, with crumpled paper in it."""
    group = BodyBuilder(spec, name, at_m)
    for k, turn in enumerate(np.radians(np.arange(12) * 30.0)):
        at_m = (0.145 * float(np.cos(turn)), 0.145 * float(np.sin(turn)), 0.16)
        group.box((0.004, 0.043, 0.16), at_m, material, (0, 7.0, 30.0 * k))
    group.drum(0.125, 0.004, (0, 0, 0.01), material)
    for k in range(5):
        turn = 2.4 * k
        where = (0.06 * np.cos(turn), 0.06 * np.sin(turn), 0.24 + 0.016 * k)
        group.ball((0.05, 0.042, 0.038), where, "white", (40 * k, 25 * k, 70 * k))


def desk_lamp(spec: mujoco.MjSpec, name: str, at_m: Point, yaw_deg: float = 0) -> Point:
    """Stands a jointed lamp; returns where its bulb is, m."""
    group = BodyBuilder(spec, name, at_m, yaw_deg)
    group.drum(0.085, 0.01, (0, 0, 0.01), "metal")
    group.rod((0, 0, 0.02), (-0.12, 0.02, 0.3), 0.0075, "metal")
    group.ball((0.015, 0.015, 0.015), (-0.12, 0.02, 0.3), "red")
    group.rod((-0.12, 0.02, 0.3), (0.1, -0.06, 0.46), 0.0075, "metal")
    group.ball((0.075, 0.075, 0.042), (0.125, -0.07, 0.45), "dark", (0, 20, 0))
    turn = np.radians(yaw_deg)
    x, y = 0.135, -0.07
    return (
        at_m[0] + float(np.cos(turn) * x - np.sin(turn) * y),
        at_m[1] + float(np.sin(turn) * x + np.cos(turn) * y),
        at_m[2] + 0.405,
    )
