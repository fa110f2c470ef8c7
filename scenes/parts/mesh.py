"""Meshes made of numbers: prisms with a painted skin, and clouds of leaf cards."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from eventsweep.scenes.parts.shadows import SHELL_GROUP

if TYPE_CHECKING:
    import mujoco

Points = NDArray[np.float64]


def prism(
    spec: mujoco.MjSpec,
    name: str,
    profile_m: ArrayLike,
    half_m: float,
    top_half_m: float | None = None,
) -> None:
    """Adds the mesh of a convex profile (N, 2) in x and z, extruded along y, flat shaded.

    A texture covers the profile's bounding rectangle once, seen from -y; the rim takes its edge.

    Args:
        spec: edited in place.
        name: of the mesh.
        profile_m: corners, counter-clockwise seen from -y.
        half_m: half its thickness at the profile's lowest corner.
        top_half_m: the same at the highest corner; None for a straight prism.
    """
    flat = np.asarray(profile_m, float)
    low, high = flat.min(axis=0), flat.max(axis=0)
    share = (flat - low) / (high - low)
    top = half_m if top_half_m is None else top_half_m
    depth = half_m + share[:, 1] * (top - half_m)
    near, far = (np.column_stack([flat[:, 0], s * depth, flat[:, 1]]) for s in (-1, 1))
    polygons = [(near, share), (far[::-1], share[::-1])]
    count = len(flat)
    for k in range(count):
        j = (k + 1) % count
        corners = np.stack([near[j], near[k], far[k], far[j]])
        polygons.append((corners, share[[j, k, k, j]]))
    _add(spec, name, polygons)


def _add(spec: mujoco.MjSpec, name: str, polygons: list[tuple[Points, Points]]) -> None:
    """Adds flat convex polygons (corners (K, 3), texture coordinates (K, 2)) as one mesh."""
    vertices, faces, normals, texture = [], [], [], []
    start = 0
    for corners, at in polygons:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= np.linalg.norm(normal)
        vertices.append(corners)
        texture.append(at)
        normals.append(np.tile(normal, (len(corners), 1)))
        faces += [(start, start + k, start + k + 1) for k in range(1, len(corners) - 1)]
        start += len(corners)
    _put(spec, name, np.concatenate(vertices), np.array(faces), np.concatenate(normals),
         np.concatenate(texture))  # fmt: skip


def cards(
    spec: mujoco.MjSpec,
    name: str,
    centres_m: Points,
    leaf_m: float,
    rng: Generator,
    stretch: float = 1.6,
) -> None:
    """Adds one mesh of leaves at `centres_m` (N, 3): pointed cards that show from both sides.

    Every leaf shows one cell of a palette from `scenes.textures.outdoor.leaves`. Normals point away
    from the middle and up, so that the cloud is shaded like a crown and not like confetti.

    Args:
        spec: edited in place.
        name: of the mesh.
        centres_m: middles of the leaves.
        leaf_m: half the width of a leaf.
        rng: source of turns, sizes and cells.
        stretch: length over width.
    """
    from eventsweep.scenes.textures.outdoor import PALETTE_CELLS

    count = len(centres_m)
    axes = np.linalg.qr(rng.standard_normal((count, 3, 3)))[0]
    size = leaf_m * rng.uniform(0.7, 1.3, (count, 1))
    along, across = axes[:, 0] * size * stretch, axes[:, 1] * size
    quads = np.stack([-along, 0.2 * along + across, along, 0.2 * along - across], axis=1)
    quads += centres_m[:, None]
    outward = centres_m - centres_m.mean(axis=0)
    outward = outward / (np.abs(outward).max(axis=0) + 1e-9) + (0, 0, 0.5)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    cell = rng.integers(PALETTE_CELLS, size=(count, 1, 2))
    corner = np.array([[0.5, 0.05], [0.95, 0.6], [0.5, 0.95], [0.05, 0.6]])
    at = (cell + corner[None]) / PALETTE_CELLS
    first = 8 * np.arange(count)[:, None, None]
    # Back faces are culled, so each card has a front and a back.
    sides = np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]])
    both = np.concatenate([quads, quads], axis=1).reshape(-1, 3)
    _put(
        spec, name, both, (first + sides).reshape(-1, 3),
        np.repeat(outward, 8, axis=0), np.concatenate([at, at], axis=1).reshape(-1, 2),
    )  # fmt: skip


def crown(rng: Generator, count: int, half_m: ArrayLike, lumps: int = 7) -> Points:
    """Returns middles of leaves (count, 3) of a tree's crown about the origin, in lumps.

    Args:
        rng: source.
        count: leaves.
        half_m: (3,) half axes of the crown.
        lumps: boughs; each carries its own ball of leaves.
    """
    way = rng.standard_normal((lumps, 3))
    middles = 0.62 * way / np.linalg.norm(way, axis=1, keepdims=True)
    middles[0] = 0
    ball = rng.standard_normal((count, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    ball *= 0.5 * rng.uniform(0.55, 1.0, (count, 1))
    return np.asarray((middles[rng.integers(lumps, size=count)] + ball) * np.asarray(half_m))


def place(
    spec: mujoco.MjSpec,
    mesh: str,
    name: str,
    at_m: ArrayLike,
    material: str,
    yaw_deg: float = 0.0,
    body: mujoco.MjsBody | None = None,
) -> None:
    """Puts a mesh into the scene, its own origin at `at_m` (3,), turned about z."""
    import mujoco

    half = np.radians(yaw_deg) / 2
    (body or spec.worldbody).add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, pos=np.asarray(at_m, float),
        quat=[np.cos(half), 0, 0, np.sin(half)], material=material, group=SHELL_GROUP,
    )  # fmt: skip


def _put(
    spec: mujoco.MjSpec, name: str, vertices: Points, faces: Points, normals: Points, at: Points
) -> None:
    import mujoco

    spec.add_mesh(
        name=name,
        uservert=vertices.ravel().tolist(),
        userface=faces.ravel().tolist(),
        usernormal=normals.ravel().tolist(),
        # MuJoCo's second texture coordinate runs down the picture.
        usertexcoord=(at * (1, -1) + (0, 1)).ravel().tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )


def sticks(spec: mujoco.MjSpec, name: str, segments_m: ArrayLike, radius_m: float) -> None:
    """Adds one mesh of straight three-sided sticks between the ends in `segments_m` (N, 2, 3)."""
    polygons = []
    turn = 2 * np.pi * np.arange(3)[:, None] / 3
    for start, end in np.asarray(segments_m, float):
        along = (end - start) / np.linalg.norm(end - start)
        across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        across /= np.linalg.norm(across)
        ring = radius_m * (np.cos(turn) * across + np.sin(turn) * np.cross(along, across))
        for k in range(3):
            a, b = ring[k], ring[(k + 1) % 3]
            corners = np.stack([start + a, start + b, end + b, end + a])
            polygons.append((corners, np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])))
    _add(spec, name, polygons)
