"""What stands outdoors: trees, houses, parked cars, fences, lamp posts, and their shadows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator

from eventsweep.scenes.parts import mesh
from eventsweep.scenes.parts.furniture import BodyBuilder, Point

if TYPE_CHECKING:
    import mujoco

_BODY_M = (
    (-2.10, 0.28), (2.10, 0.28), (2.17, 0.50), (2.06, 0.72), (0.95, 0.90), (-1.70, 0.92),
    (-2.12, 0.82), (-2.19, 0.50),
)  # fmt: skip
_CABIN_M = ((-1.80, 0.88), (1.05, 0.88), (0.30, 1.42), (-1.20, 1.45))
_LIGHT_SLOPE = np.array([0.5, 0.56])
"""How far a shadow of the key light reaches over the ground, per metre of height."""


@dataclass(frozen=True)
class Trees:
    """Kinds of crowns: meshes of leaves that many trees share."""

    crowns: tuple[str, ...]
    height_m: float

    @classmethod
    def grown(
        cls,
        spec: mujoco.MjSpec,
        name: str,
        rng: Generator,
        *,
        half_m: Point,
        leaf_m: float,
        leaves: int = 1400,
        kinds: int = 2,
    ) -> Trees:
        """Adds `kinds` meshes of crowns with the half axes `half_m`."""
        crowns = tuple(f"{name}_{k}" for k in range(kinds))
        for crown in crowns:
            mesh.cards(spec, crown, mesh.crown(rng, leaves, half_m), leaf_m, rng)
        return cls(crowns, half_m[2])

    def plant(
        self,
        spec: mujoco.MjSpec,
        name: str,
        at_m: tuple[float, float],
        trunk_m: float,
        rng: Generator,
        *,
        shadow: str | None = "shade",
        leaves: str = "leaves",
    ) -> None:
        """Plants a tree: trunk with boughs up to `trunk_m`, and a crown around its top."""
        x, y = at_m
        tree = BodyBuilder(spec, name, (x, y, 0))
        radius = 0.045 * trunk_m
        tree.drum(radius, trunk_m / 2, (0, 0, trunk_m / 2), "bark")
        for turn in rng.uniform(0, 360, 3):
            out = 0.5 * self.height_m * np.array([np.cos(turn), np.sin(turn)])
            tip = (float(out[0]), float(out[1]), trunk_m + 0.6 * self.height_m)
            tree.rod((0, 0, 0.94 * trunk_m), tip, 0.4 * radius, "bark")
        middle = trunk_m + 0.62 * self.height_m
        crown = self.crowns[int(rng.integers(len(self.crowns)))]
        yaw = float(rng.uniform(0, 360))
        mesh.place(spec, crown, f"{name}_crown", (x, y, middle), leaves, yaw)
        if shadow is not None:
            reach = middle * _LIGHT_SLOPE
            size = (0.85 * self.height_m, 0.95 * self.height_m)
            shade(spec, f"{name}_shade", (x + reach[0], y + reach[1]), size, shadow)


def shade(
    spec: mujoco.MjSpec,
    name: str,
    at_m: tuple[float, float],
    half_m: tuple[float, float],
    material: str = "shade",
    level_m: float = 0.0,
) -> None:
    """Lays the round shadow of a crown on the ground: a disc of the ground's darker twin."""
    spot = BodyBuilder(spec, name, (*at_m, level_m))
    spot.ball((*half_m, 0.008), (0, 0, 0), material)


def car(
    spec: mujoco.MjSpec, name: str, at_m: tuple[float, float], yaw_deg: float, paint: str
) -> None:
    """Parks a car of materials `paint` and `paint`_cabin, its front along the turned x axis."""
    if not any(known.name == "car_body" for known in spec.meshes):  # all cars share it
        mesh.prism(spec, "car_body", _BODY_M, 0.86, 0.80)
        mesh.prism(spec, "car_cabin", _CABIN_M, 0.80, 0.60)
    mesh.place(spec, "car_body", f"{name}_body", (*at_m, 0), paint, yaw_deg)
    mesh.place(spec, "car_cabin", f"{name}_cabin", (*at_m, 0), f"{paint}_cabin", yaw_deg)
    parts = BodyBuilder(spec, name, (*at_m, 0), yaw_deg)
    for x in (-1.32, 1.32):
        for y in (-0.78, 0.78):
            parts.drum(0.31, 0.11, (x, y, 0.31), "wheel", (90, 0, 0))
    for y in (-0.62, 0.62):
        parts.box((0.02, 0.13, 0.06), (2.13, y, 0.66), "white")
        parts.box((0.02, 0.10, 0.09), (-2.16, y, 0.70), "red")
    parts.box((0.02, 0.24, 0.05), (-2.18, 0, 0.56), "white")
    parts.box((0.02, 0.24, 0.05), (2.165, 0, 0.46), "white")
    parts.box((2.05, 0.84, 0.004), (0.1, 0.06, 0.006), "contact")


def house(
    spec: mujoco.MjSpec,
    name: str,
    at_m: tuple[float, float],
    half_m: Point,
    front: str,
    *,
    yaw_deg: float = 0.0,
    roof: str = "roof",
) -> None:
    """Builds a house with a saddle roof, its ridge along x, its front towards -y."""
    width, depth, height = half_m
    walls = BodyBuilder(spec, name, (*at_m, 0), yaw_deg)
    walls.box((width, depth, height), (0, 0, height), front)
    rise = 0.75 * depth
    slope = float(np.degrees(np.arctan2(rise, depth)))
    half = 0.5 * float(np.hypot(rise, depth)) + 0.25
    for side in (-1, 1):
        middle = (0.0, side * (0.5 * depth + 0.1), 2 * height + 0.5 * rise)
        walls.box((width + 0.3, half, 0.08), middle, roof, (-side * slope, 0, 0))
    walls.box((0.35, 0.3, 0.9), (0.5 * width, 0.25 * depth, 2 * height + rise), "chimney")


def fence(
    spec: mujoco.MjSpec,
    name: str,
    start_m: tuple[float, float],
    end_m: tuple[float, float],
    *,
    every_m: float = 2.4,
    height_m: float = 1.1,
    rails: Sequence[float] = (0.35, 0.7, 1.0),
    material: str = "plank",
) -> None:
    """Puts up posts with rails at shares `rails` of their height."""
    a, b = np.asarray(start_m), np.asarray(end_m)
    length = float(np.linalg.norm(b - a))
    yaw = float(np.degrees(np.arctan2(b[1] - a[1], b[0] - a[0])))
    run = BodyBuilder(spec, name, (a[0], a[1], 0), yaw)
    for k in range(int(length / every_m) + 1):
        run.box((0.05, 0.05, height_m / 2), (k * every_m, 0, height_m / 2), material)
    for share in rails:
        run.box((length / 2, 0.02, 0.05), (length / 2, -0.06, share * height_m), material)


def lamp_post(
    spec: mujoco.MjSpec, name: str, at_m: tuple[float, float], height_m: float, yaw_deg: float
) -> None:
    """Puts up a street lamp whose arm points along the turned x axis."""
    post = BodyBuilder(spec, name, (*at_m, 0), yaw_deg)
    post.rod((0, 0, 0), (0, 0, 0.9), 0.085, "steel")
    post.rod((0, 0, 0.9), (0, 0, height_m), 0.05, "steel")
    post.rod((0, 0, height_m), (1.1, 0, height_m + 0.25), 0.035, "steel")
    post.box((0.28, 0.1, 0.05), (1.3, 0, height_m + 0.24), "white")


def sign(
    spec: mujoco.MjSpec, name: str, at_m: tuple[float, float], face: str, height_m: float = 2.2
) -> None:
    """Puts up a road sign that faces -y."""
    post = BodyBuilder(spec, name, (*at_m, 0))
    post.rod((0, 0.04, 0), (0, 0.04, height_m + 0.2), 0.03, "steel")
    post.drum(0.3, 0.012, (0, 0, height_m), face, (90, 0, 0))


def bench(spec: mujoco.MjSpec, name: str, at_m: tuple[float, float], yaw_deg: float) -> None:
    """Puts a park bench, its back towards the turned y axis."""
    seat = BodyBuilder(spec, name, (*at_m, 0), yaw_deg)
    for k in range(3):
        seat.box((0.85, 0.055, 0.02), (0, -0.14 + 0.14 * k, 0.45), "plank")
    for z in (0.62, 0.78):
        seat.box((0.85, 0.02, 0.055), (0, 0.24, z), "plank")
    for x in (-0.65, 0.65):
        seat.box((0.03, 0.2, 0.22), (x, 0, 0.22), "steel")
        seat.box((0.03, 0.02, 0.42), (x, 0.27, 0.42), "steel")
