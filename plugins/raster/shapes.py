"""Surfaces of geoms in triangles, corner by corner as MuJoCo's classic renderer makes them.

Round things are polygons of `visual/quality` slices and stacks; depth and geoms are those of the
polygons in both renderers, so they must be the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Lines of a plane's grid along a side, at most; a plane without end has as many.
_MOST_LINES = 200
# A corner whose normal leans further from its face, as a cosine, is lit as the face.
_SMOOTH = 0.8


class Part(NamedTuple):
    """Triangles of a shape of unit size, counter-clockwise seen from outside.

    Attributes:
        corners: (T, 3, 3).
        normals: (T, 3, 3) of the corners, of length 1.
        places: (T, 3, 2) where the corners lie in a flat texture.
    """

    corners: Array
    normals: Array
    places: Array


def sheet(*grids: Array) -> Part:
    """A grid of four-sided faces, each cut in two; what has no area is left out.

    `grids` are corners (R, C, 3), normals (R, C, 3) and places (R, C, 2).
    """
    four = [
        (slice(None, -1), slice(None, -1)), (slice(None, -1), slice(1, None)),
        (slice(1, None), slice(1, None)), (slice(1, None), slice(None, -1)),
    ]  # fmt: skip
    made = []
    for grid in grids:
        quads = np.stack([grid[at] for at in four], axis=2).reshape(-1, 4, grid.shape[2])
        made.append(quads[:, [[0, 1, 3], [1, 2, 3]]].reshape(-1, 3, grid.shape[2]))
    a, b, c = made[0].transpose(1, 0, 2)
    flat = (a == b).all(1) | (b == c).all(1) | (c == a).all(1)
    return Part(*(each[~flat] for each in made))


def joined(parts: Sequence[Part]) -> Part:
    """Parts as one."""
    return Part(*map(np.concatenate, zip(*parts, strict=True)))


def _circle(count: int, turns: float = 1.0, first: float = 0.0) -> Array:
    """(count + 1, 2) cosine and sine of even angles, in 32 bits: there all libraries agree."""
    angles = [2 * math.pi * (first + turns * k / count) for k in range(count + 1)]
    at = np.array([(math.cos(angle), math.sin(angle)) for angle in angles], np.float32)
    return at.astype(np.float64)


def _turned(profile: Array, leaning: Array, down: Array, slices: int) -> Part:
    """A surface of revolution.

    Args:
        profile: (R, 2) radius and height, bottom first.
        leaning: (R, 2) the same of normals.
        down: (R,) where these lie in a texture that goes around.
        slices: how many.
    """
    around = _circle(slices)
    around[-1] = around[0]
    grids = [
        np.concatenate(
            [line[:, None, :1] * around, np.tile(line[:, None, 1:], (1, slices + 1, 1))], axis=2
        )
        for line in (profile, leaning)
    ]
    places = np.dstack(np.meshgrid(np.arange(slices + 1) / slices, down))
    part = sheet(*grids, places)
    # At a pole, every triangle has the middle of its other corners.
    poles = (part.corners[..., :2] == 0).all(-1)
    along = part.places[..., 0]
    part.places[..., 0] = np.where(poles, (along.sum(1)[:, None] - along) / 2, along)
    return part


def _arc(stacks: int, turns: float, first: float) -> Array:
    """(stacks + 1, 2) radius and height along a circle; at a pole the radius is 0."""
    arc = _circle(stacks, turns, first)
    arc[np.abs(arc) < 1e-6] = 0
    return arc


@lru_cache(maxsize=8)
def sphere(slices: int, stacks: int) -> Part:
    """A ball of radius 1."""
    arc = _arc(2 * (stacks // 2), 0.5, -0.25)
    return _turned(arc, arc, np.linspace(1, 0, len(arc)), slices)


@lru_cache(maxsize=16)
def cap(top: bool, slices: int, stacks: int) -> Part:
    """Half a ball, its flat side at 1 or -1: textures go on from the cylinder in between."""
    arc = _arc(stacks // 2, 0.25, 0.0 if top else -0.25)
    return _turned(np.add(arc, [0, 1 if top else -1]), arc, np.linspace(1, 0, len(arc)), slices)


@lru_cache(maxsize=8)
def tube(slices: int, stacks: int) -> Part:
    """A cylinder without ends, of radius 1, from -1 to 1."""
    height = np.linspace(-1, 1, stacks + 1)
    outwards = np.column_stack([np.ones_like(height), np.zeros_like(height)])
    profile = np.column_stack([np.ones_like(height), height])
    return _turned(profile, outwards, (1 - height) / 2, slices)


@lru_cache(maxsize=16)
def disc(top: bool, slices: int, stacks: int) -> Part:
    """An end of the cylinder."""
    side = 1.0 if top else -1.0
    radius = np.arange(stacks // 2 + 1) / (stacks // 2)
    radius = radius[::-1] if top else radius
    up = np.column_stack([np.zeros_like(radius), np.full_like(radius, side)])
    part = _turned(np.column_stack([radius, np.full_like(radius, side)]), up, radius, slices)
    return part._replace(places=0.5 + 0.5 * part.corners[..., :2])


@lru_cache(maxsize=8)
def cylinder(slices: int, stacks: int) -> Part:
    """A closed cylinder of radius 1, from -1 to 1."""
    ends = (disc(top, slices, stacks) for top in (False, True))
    return joined([*ends, tube(slices, stacks)])


def _flat(across: Any, up: Any, axis: int, at: float) -> Part:
    """A flat grid whose columns follow one axis and whose rows another, seen from `at`'s side."""
    first, second = ((0, 1), (1, 2), (0, 2))[(2, 0, 1).index(axis)]
    grid = np.empty((len(up), len(across), 3))
    grid[..., first], grid[..., second], grid[..., axis] = across[None], up[:, None], at
    normals = np.zeros_like(grid)
    normals[..., axis] = np.sign(at) or 1.0
    return sheet(grid, normals, np.dstack(np.meshgrid((across + 1) / 2, (1 - up) / 2)))


@lru_cache(maxsize=8)
def box(quads: int) -> Part:
    """A box from -1 to 1, each side of so many faces in a row and in a column."""
    line = np.arange(quads + 1) * (2.0 / quads) - 1
    return joined(
        [
            _flat(line, line if side * (1, -1, 1)[axis] > 0 else line[::-1], axis, side)
            for axis in (2, 0, 1)
            for side in (1.0, -1.0)
        ]
    )


def plane(model: Any, geom_id: int, *, coarse: bool) -> Part:
    """A plane in its own size; one without end is as large as MuJoCo's, in one face if coarse."""
    lines = [_lines(model, geom_id, k, coarse=coarse) for k in (0, 1)]
    part = _flat(lines[0], lines[1], 2, 0.0)
    half = model.geom_size[geom_id, :2]
    places = 0.5 * part.corners[..., :2] * [1, -1] / np.where(half > 0, half, 1)
    return part._replace(places=places + np.where(half > 0, 0.5, 0))


def _lines(model: Any, geom_id: int, axis: int, *, coarse: bool) -> Array:
    half, spacing = float(model.geom_size[geom_id, axis]), float(model.geom_size[geom_id, 2])
    if half > 0:
        spacing = max(spacing, half / (_MOST_LINES - 2))
        count = int(half / max(1e-15, spacing)) // 2 * 2
        inner = (np.arange(count + 1) * 2 - count) * spacing
        return np.concatenate([[-half], inner, [half]])
    reach = 2.1 * float(model.vis.map.zfar * model.stat.extent)
    material = int(model.geom_matid[geom_id])
    repeat = float(model.mat_texrepeat[material, axis]) if material >= 0 else 0.0
    step = (reach + 2 * (2 / repeat if repeat > 0 else reach / (_MOST_LINES - 2))) / _MOST_LINES
    ends = np.arange(_MOST_LINES + 1) * step - step * (_MOST_LINES // 2)
    return np.asarray(ends[[0, -1]] if coarse else ends, float)


def mesh(model: Any, mesh_id: int) -> Part:
    """A mesh as it lies in the model."""
    faces = slice(model.mesh_faceadr[mesh_id], None)
    faces = slice(faces.start, faces.start + model.mesh_facenum[mesh_id])
    corners = _looked_up(model.mesh_vert, model.mesh_vertadr, model.mesh_face, mesh_id, faces)
    normals = _looked_up(
        model.mesh_normal, model.mesh_normaladr, model.mesh_facenormal, mesh_id, faces
    )
    if model.mesh_texcoordadr[mesh_id] >= 0:
        its = model.mesh_texcoord, model.mesh_texcoordadr, model.mesh_facetexcoord
        return Part(corners, normals, _looked_up(*its, mesh_id, faces))
    flat = _face_normals(corners)[:, None]
    leaning = (normals * flat).sum(-1, keepdims=True) < _SMOOTH
    return Part(corners, np.where(leaning, flat, normals), corners[..., :2])


def _looked_up(values: Any, first: Any, index: Any, mesh_id: int, faces: slice) -> Array:
    """(T, 3, N) what the corners of a mesh's faces have."""
    found: Array = values[first[mesh_id] + index[faces]].astype(np.float64)
    return found


def _face_normals(corners: Array) -> Array:
    """(T, 3) of triangles; of those without area, up."""
    a, b, c = corners.transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 1e-12, normals / np.maximum(length, 1e-12), [0.0, 0.0, 1.0])


def height_field(model: Any, field_id: int) -> Part:
    """A height field with its sides and its bottom."""
    rows, columns = int(model.hfield_nrow[field_id]), int(model.hfield_ncol[field_id])
    half_x, half_y, scale, depth = model.hfield_size[field_id].tolist()
    first = model.hfield_adr[field_id]
    height = scale * model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    x, y = half_x * np.linspace(-1, 1, columns), half_y * np.linspace(-1, 1, rows)
    top = np.dstack([*np.meshgrid(x, y), height.astype(np.float64)])
    a, b, c, d = top[1:, :-1], top[:-1, :-1], top[1:, 1:], top[:-1, 1:]
    faces = np.stack([a, b, c, b, d, c], axis=2).reshape(-1, 3, 3)
    normals = np.broadcast_to(_face_normals(faces)[:, None], faces.shape)
    down = -float(depth)
    sides = (
        (top[::-1, 0], (-1, 0, 0)), (top[:, -1], (1, 0, 0)),
        (top[0], (0, -1, 0)), (top[-1, ::-1], (0, 1, 0)),
    )  # fmt: skip
    walls = [_wall(edge, np.array(normal, float), down) for edge, normal in sides]
    count = model.vis.quality.numquads
    line = np.arange(count + 1) * (2.0 / count) - 1
    floor = _flat(half_x * line, half_y * line[::-1], 2, 0.0)
    below = Part(np.add(floor.corners, [0, 0, down]), -floor.normals, floor.places)
    whole = joined([Part(faces, normals, faces[..., :2]), *walls, below])
    return whole._replace(places=whole.corners[..., :2])


def _wall(edge: Array, normal: Array, down: float) -> Part:
    """From an edge (N, 3) of the top down to the bottom."""
    low = edge.copy()
    low[:, 2] = down
    grid = np.stack([low, edge])
    return sheet(grid, np.broadcast_to(normal, grid.shape), grid[..., :2])
