"""Things too many or too curved to write down in MJCF: rows of books, plants, cables, shadows."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    import mujoco

_BOOKS = 8  # materials book_0 to book_7


def box(
    spec: mujoco.MjSpec,
    name: str,
    half_m: ArrayLike,
    at_m: ArrayLike,
    material: str,
    turned: Rotation | None = None,
) -> None:
    """Puts a box of half sizes (3,), m, at its middle (3,), turned about its middle."""
    x, y, z, w = (0, 0, 0, 1) if turned is None else turned.as_quat()
    spec.worldbody.add_geom(
        name=name,
        type=geom_type("BOX"),
        size=half_m,
        pos=at_m,
        quat=[w, x, y, z],
        material=material,
    )


def book_row(
    spec: mujoco.MjSpec,
    name: str,
    at_m: tuple[float, float, float],
    width_m: float,
    height_m: tuple[float, float],
    rng: Generator,
    depth_m: float = 0.09,
) -> None:
    """Stands books side by side along +x, spines towards -y; the last one leans.

    Args:
        spec: edited in place.
        name: prefix of the geoms' names.
        at_m: left end of the row, on the board, where the spines are.
        width_m: how much of the board the row fills.
        height_m: least and greatest height of a book.
        rng: source of sizes and places.
        depth_m: half the depth of the deepest book.
    """
    x, order = at_m[0], rng.permutation(_BOOKS)
    count = 0
    while x < at_m[0] + width_m:
        half = np.array([rng.uniform(0.010, 0.024), depth_m * rng.uniform(0.75, 1.0), 0.0])
        half[2] = 0.5 * rng.uniform(*height_m)
        leaning = x + 2 * half[0] >= at_m[0] + width_m
        lean = np.radians(rng.uniform(9, 14)) if leaning else 0.0
        reach = half[0] * np.cos(lean) + half[2] * np.sin(lean)
        rise = half[2] * np.cos(lean) + half[0] * np.sin(lean)
        centre = (x + reach, at_m[1] + half[1] + rng.uniform(0, 0.03), at_m[2] + rise)
        material, turned = f"book_{order[count % _BOOKS]}", Rotation.from_rotvec([0, -lean, 0])
        box(spec, f"{name}_{count}", half, centre, material, turned)
        x += 2 * half[0] + 0.001
        count += 1


def plant(
    spec: mujoco.MjSpec,
    name: str,
    at_m: ArrayLike,
    size_m: float,
    rng: Generator,
    leaves: int = 18,
    material: str = "leaf",
) -> None:
    """Grows thin stems with flat leaves from one point, `size_m` high."""
    root = np.asarray(at_m, float)
    for k in range(leaves):
        turn = k * np.radians(137.5) + rng.uniform(-0.2, 0.2)
        rise = np.radians(82 - 52 * (k / leaves) + rng.uniform(-6, 6))
        out = np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
        stem = size_m * rng.uniform(0.45, 0.75)
        tip = root + stem * out
        rod(spec, f"{name}_stem_{k}", root, tip, 0.0022, material)
        half = size_m * rng.uniform(0.17, 0.25)
        along = out + np.array([0, 0, -0.55])
        along /= np.linalg.norm(along)
        spec.worldbody.add_geom(
            name=f"{name}_leaf_{k}",
            type=geom_type("ELLIPSOID"),
            size=[half, 0.36 * half, 0.0022],
            pos=tip + 0.85 * half * along,
            quat=_facing(along),
            material=material,
        )


def cable(
    spec: mujoco.MjSpec, name: str, points_m: ArrayLike, radius_m: float, material: str
) -> None:
    """Lays a cable through points (N, 3) as a smooth chain of capsules."""
    from scipy.interpolate import CubicSpline  # scenes without cables need not wait for it

    points = np.asarray(points_m, float)
    curve = CubicSpline(np.arange(len(points)), points)
    fine = curve(np.linspace(0, len(points) - 1, 4 * len(points)))
    for k, (a, b) in enumerate(pairwise(fine)):
        rod(spec, f"{name}_{k}", a, b, radius_m, material)


def rod(
    spec: mujoco.MjSpec,
    name: str,
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    radius_m: float,
    material: str,
) -> None:
    """Puts a capsule between two points (3,), m."""
    ends, size = [*a.tolist(), *b.tolist()], [radius_m, 0, 0]
    spec.worldbody.add_geom(
        name=name, type=geom_type("CAPSULE"), size=size, fromto=ends, material=material
    )


def _facing(along: NDArray[np.float64]) -> list[float]:
    """Quaternion (w, x, y, z) whose x axis is `along` and whose z axis is as upright as it can."""
    across = np.cross([0.0, 0.0, 1.0], along)
    across /= np.linalg.norm(across)
    axes = np.column_stack([along, across, np.cross(along, across)])
    x, y, z, w = Rotation.from_matrix(axes).as_quat()
    return [w, x, y, z]


def geom_type(name: str) -> Any:
    """MuJoCo's number of a kind of geom, such as BOX."""
    import mujoco

    return getattr(mujoco.mjtGeom, f"mjGEOM_{name}")
