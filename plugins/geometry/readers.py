"""Geometries to points in the world: clouds as they are, meshes sampled, splats by their centres.

Everything is taken in metres and in the world of the sequence, unless it is aligned later.
"""

from __future__ import annotations

import io
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth.tsdf import load_open3d
from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.utils.inputs import check_file
from eventsweep.eval.scoring.predictions import plain
from eventsweep.plugins.geometry.config import SUFFIXES, GeometryConfig
from eventsweep.plugins.geometry.pcd import read_pcd
from eventsweep.plugins.geometry.ply import PlyFile, read_ply

Points = NDArray[np.float64]
MOST_SAMPLES = 10_000_000
"""Points that are drawn from a mesh at most."""
_BLOCK = 1_000_000
_FARTHEST_M = 1e6
_PER_CELL = 4  # samples of a mesh per square of a cell's edge
_OF_SPLATS = {"opacity", "scale_0", "rot_0"}
# In a process of its own: a library in C++ may end on a damaged file.
_READ_MESH = """
import sys, numpy as np, open3d as o3d
mesh = o3d.io.read_triangle_mesh(sys.argv[1])
np.savez(sys.stdout.buffer, v=np.asarray(mesh.vertices), t=np.asarray(mesh.triangles))
"""
_MOST_SECONDS = 600


@dataclass(frozen=True, eq=False)
class Geometry:
    """Points on what somebody says the surfaces are.

    Attributes:
        name: of the method, as tables show it.
        path: the file.
        points: (N, 3) float64, m.
        kind: `points`, `mesh` or `splats`.
        about: how the points were made of the file, in a few words.
    """

    name: str
    path: Path
    points: Points
    kind: str
    about: str


class _Named(NamedTuple):
    name: str
    path: Path


def read_geometry(asked: str, config: GeometryConfig) -> Geometry:
    """Reads `FILE` or `NAME=FILE`.

    Raises:
        InputError: no such file, an unknown or damaged one, or one without a point that can be used
            for scoring.
    """
    name, path = _named(asked)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            f"{path}: geometries of kind {quoted(suffix)} are not read; convert it to one of "
            f"{', '.join(SUFFIXES)}"
        )
    try:
        kind, points, about = _points(path, suffix, config)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    _check(path, points)
    return Geometry(name, path, points, kind, about)


def _named(asked: str) -> _Named:
    name, equals, place = asked.partition("=")
    if not equals or "/" in name or Path(asked).exists():
        name, place = "", asked
    elif not name.strip() or not place:
        raise InputError(f"geometry {asked!r}: needs NAME=FILE or FILE")
    path = Path(place)
    return _Named(plain(name.strip() or path.resolve().stem), path)


def _points(path: Path, suffix: str, config: GeometryConfig) -> tuple[str, Points, str]:
    if suffix == ".pcd":
        points = read_pcd(path)
        return "points", points, f"{len(points):,} points"
    if suffix != ".ply":
        return _sampled(path, *_open3d_mesh(path), config)
    file = read_ply(path, only={*"xyz", *_OF_SPLATS})
    if missing := [axis for axis in "xyz" if axis not in file.vertices]:
        raise InputError(f"{path}: its vertices have no {', '.join(missing)}; export coordinates")
    points = np.column_stack([file.vertices[axis] for axis in "xyz"])
    if len(file.triangles):
        return _sampled(path, points, file.triangles, config)
    if file.vertices.keys() >= _OF_SPLATS:
        return _centres(path, file, points, config)
    return "points", points, f"{len(points):,} points"


def _centres(
    path: Path, file: PlyFile, points: Points, config: GeometryConfig
) -> tuple[str, Points, str]:
    """Centres of the splats that are opaque enough; the file holds the logit of the opacity."""
    with np.errstate(over="ignore"):
        opacity = 1 / (1 + np.exp(-file.vertices["opacity"]))
    if np.isnan(opacity).any():
        raise InputError(f"{path}: {np.isnan(opacity).sum():,} splats have no opacity (NaN)")
    kept = opacity >= config.least_opacity
    if not kept.any() and len(points):
        raise InputError(
            f"{path}: none of {len(points):,} splats has an opacity of {config.least_opacity:g}: "
            "lower least_opacity"
        )
    about = (
        f"{int(kept.sum()):,} centres of {len(points):,} splats, opacity "
        f"{config.least_opacity:g} or more"
    )
    return "splats", points[kept], about


def _sampled(
    path: Path, vertices: Points, triangles: NDArray[np.int64], config: GeometryConfig
) -> tuple[str, Points, str]:
    """Points drawn from a mesh, evenly by area."""
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise InputError(
            f"{path}: a face names vertex {int(triangles.max()):,}, there are {len(vertices):,}: "
            "the file is damaged"
        )
    used = np.zeros(len(vertices), np.bool_)
    used[triangles.ravel()] = True
    _check(path, vertices[used])
    density = config.samples_per_m2 or _PER_CELL / config.cell_m**2
    points, area_m2 = sample_mesh(vertices, triangles, density, config.sampling_seed)
    if not len(points):
        raise InputError(f"{path}: its faces have an area of {area_m2:.3g} m²: nothing to score")
    per_m2 = len(points) / area_m2
    about = f"{len(points):,} points of {area_m2:,.4g} m² of faces, {per_m2:,.0f} per m²"
    return "mesh", points, about


def sample_mesh(
    vertices: Points, triangles: NDArray[np.int64], per_m2: float, seed: int
) -> tuple[Points, float]:
    """Points drawn evenly by area from a mesh, and its area in m².

    Every stretch of area as long as a point stands for holds one: stratified, so that how many
    points a face gets differs from its share by less than one.

    Args:
        vertices: (V, 3), m.
        triangles: (T, 3) numbers of vertices.
        per_m2: points per m²; at most `MOST_SAMPLES` are drawn in all.
        seed: of where they lie.
    """
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    ends = np.cumsum(area)
    area_m2 = float(ends[-1])
    count = min(int(np.ceil(area_m2 * per_m2)), MOST_SAMPLES)
    if not area_m2 or not count:
        return np.empty((0, 3)), area_m2
    rng = np.random.default_rng(seed)
    points = np.empty((count, 3))
    for first in range(0, count, _BLOCK):
        numbers = np.arange(first, min(first + _BLOCK, count))
        shift, u, v = rng.random((3, len(numbers), 1))
        at = (numbers + shift[:, 0]) * (area_m2 / count)
        face = np.minimum(np.searchsorted(ends, at, side="right"), len(ends) - 1)
        root = np.sqrt(u)
        corners = a[face] * (1 - root), b[face] * (root * (1 - v)), c[face] * (root * v)
        points[numbers] = sum(corners)
    return points, area_m2


def _open3d_mesh(path: Path) -> tuple[Points, NDArray[np.int64]]:
    """Vertices and triangles of a mesh that open3d reads, coordinates as they are written."""
    check_file(path)
    command = [sys.executable, "-c", _READ_MESH, str(path.resolve())]
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=_MOST_SECONDS)
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{path}: open3d reads it for more than {_MOST_SECONDS} s") from error
    start = done.stdout.find(b"PK\x03\x04")  # behind its warnings
    if done.returncode or start < 0:
        load_open3d()  # says what is missing, if that is the reason
        raise InputError(f"{path}: open3d ends on it: the file is damaged, export it again")
    with np.load(io.BytesIO(done.stdout[start:])) as mesh:
        vertices, triangles = mesh["v"], mesh["t"].astype(np.int64)
    if not len(triangles):
        raise InputError(
            f"{path}: open3d finds no triangles in it: it is damaged, or holds no mesh; export it "
            "as PLY"
        )
    return vertices, triangles


def _check(path: Path, points: Points) -> None:
    """Refuses what has no points, or impossible ones."""
    if not len(points):
        raise InputError(f"{path}: holds no points; export it again")
    wrong = int((~np.isfinite(points).all(axis=1)).sum())
    if wrong:
        raise InputError(
            f"{path}: {wrong:,} of {len(points):,} points are not finite (NaN); remove them"
        )
    farthest_m = float(np.abs(points).max())
    if farthest_m > _FARTHEST_M:
        raise InputError(
            f"{path}: a point {farthest_m:.3g} m from the origin; needs coordinates in metres"
        )
