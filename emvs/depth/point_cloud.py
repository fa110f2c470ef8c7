"""Depth maps to point clouds: back-projection, outlier filter, PLY, one cloud of many windows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.utils.files import atomic_path

ColourBy = Literal["depth", "confidence"]
_BITS = 21  # per axis of a cell's key; three fit an int64
_HALF = 1 << (_BITS - 1)
_MERGE_AT_LEAST = 200_000


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Coloured points in the world.

    Attributes:
        points_world: (N, 3) float64, m.
        colours: (N, 3) uint8 red, green, blue.
    """

    points_world: NDArray[np.float64]
    colours: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.points_world)


def back_project_map(depth_map: DepthMap, colour_by: ColourBy = "depth") -> PointCloud:
    """Turns every pixel with depth into a point in the world.

    Args:
        depth_map: depth in the reference view.
        colour_by: `depth`, red near to blue far over the sweep's planes, or `confidence`, red high.

    Returns:
        Points in the order of the image, row after row.
    """
    rows, columns = np.nonzero(depth_map.mask)
    bearing = depth_map.camera.unproject(np.stack([columns, rows], axis=-1))
    depth_m = depth_map.depth_m[rows, columns].astype(np.float64)[:, None]
    points_rv = np.hstack([bearing * depth_m, depth_m])
    points_world = se3.transform(depth_map.T_world_rv, points_rv)
    if colour_by == "depth":
        values = np.reciprocal(depth_map.depth_m[rows, columns])
        low, high = float(depth_map.rho.min()), float(depth_map.rho.max())
    else:
        values = depth_map.confidence[rows, columns]
        low, high = 0.0, float(depth_map.confidence.max())
    return PointCloud(points_world, palette(values, low, high))


def palette(values: NDArray[np.floating], low: float, high: float) -> NDArray[np.uint8]:
    """(..., 3) red, green, blue of values: blue from `low` down, red from `high` up."""
    grey = np.rint(255 * np.clip((values - low) / (high - low), 0, 1)).astype(np.uint8)
    turbo = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_TURBO)
    red_green_blue = turbo[:, 0, ::-1].astype(np.uint8)
    colours: NDArray[np.uint8] = red_green_blue[grey]
    return colours


def without_outliers(cloud: PointCloud, radius_m: float, neighbours: int) -> PointCloud:
    """Drops points that have fewer than `neighbours` other points nearer than `radius_m`."""
    if neighbours == 0 or len(cloud) == 0:
        return cloud
    from scipy.spatial import cKDTree  # loaded by those who ask for clouds only

    # The nearest is the point itself; one that is too far counts as infinitely far.
    nearest = [neighbours + 1]
    tree = cKDTree(cloud.points_world)
    distance_m, _ = tree.query(cloud.points_world, nearest, distance_upper_bound=radius_m)
    chosen = np.isfinite(distance_m[:, 0])
    return PointCloud(cloud.points_world[chosen], cloud.colours[chosen])


def write_ply(
    path: str | Path, cloud: PointCloud, windows: NDArray[np.int32] | None = None
) -> None:
    """Writes a binary PLY with colours, whole or not at all; open3d would refuse an empty one.

    Args:
        path: the file.
        cloud: the points.
        windows: (N,) how many windows saw each point, as a further property; None leaves it out.

    Raises:
        InputError: the folder cannot be written to.
        OSError: the disk is full.
    """
    properties = [(axis, "<f8") for axis in "xyz"] + [(c, "u1") for c in ("red", "green", "blue")]
    properties += [] if windows is None else [("windows", "<i4")]
    vertices = np.empty(len(cloud), properties)
    if windows is not None:
        vertices["windows"] = windows
    for axis, values in zip("xyz", cloud.points_world.T, strict=True):
        vertices[axis] = values
    for colour, levels in zip(("red", "green", "blue"), cloud.colours.T, strict=True):
        vertices[colour] = levels
    kinds = {"<f8": "double", "u1": "uchar", "<i4": "int"}
    header = [
        "ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}",
        *(f"property {kinds[kind]} {name}" for name, kind in properties), "end_header", "",
    ]  # fmt: skip
    with atomic_path(Path(path)) as partial, partial.open("wb") as file:
        file.write("\n".join(header).encode("ascii"))
        file.write(vertices.tobytes())


def farthest(cell: NDArray[np.float64]) -> float:
    """How many cells from the origin the farthest lies, if that is too far for a key; else 0.

    Args:
        cell: (N, 3) whole numbers.
    """
    far = float(np.abs(cell).max()) if cell.size else 0.0
    return 0.0 if far < _HALF - 1 else far


def cell_keys(cell: NDArray[np.float64]) -> NDArray[np.int64]:
    """A number for each cell of a grid, in the order of x, y, z; (N,), of (N, 3) whole numbers."""
    x, y, z = (cell.astype(np.int64) + _HALF).T
    keys: NDArray[np.int64] = (x << 2 * _BITS) | (y << _BITS) | z
    return keys


class VoxelCloud:
    """Averages points within voxels, over any number of windows, which are added one by one.

    Memory grows with the voxels that hold points, not with the points: of each voxel only sums are
    kept.
    """

    def __init__(self, voxel_m: float) -> None:
        """Starts empty."""
        self._voxel_m = voxel_m
        empty = np.empty
        self._merged = _Sums(
            empty(0, np.int64), empty((0, 6)), empty(0, np.int64), empty(0, np.int32)
        )
        self._waiting: list[_Sums] = []
        self._windows = 0

    def add(self, cloud: PointCloud) -> None:
        """Adds the points of one window.

        Raises:
            InputError: points too far from the origin for voxels of this size.
        """
        self._windows += 1
        cell = np.floor(cloud.points_world / self._voxel_m)
        inside = cloud.points_world - cell * self._voxel_m
        columns = np.hstack([inside, cloud.colours])
        n = len(cloud)
        each = _Sums(self._keys(cell), columns, np.ones(n, np.int64), np.zeros(n, np.int32))
        own = _Sums.joined([each])
        own = _Sums(own.keys, own.sums, own.points, np.ones(len(own.keys), np.int32))
        self._waiting.append(own)
        # Merging costs as much as there is: so it waits until as much has come.
        if sum(len(part.keys) for part in self._waiting) > max(_MERGE_AT_LEAST, len(self)):
            self._merge()

    def state(self) -> dict[str, Any]:
        """All that was added, as plain values and arrays."""
        parts = [vars(part) for part in (self._merged, *self._waiting)]
        return {"windows": self._windows, "parts": parts}

    def restore(self, state: dict[str, Any]) -> None:
        """Takes what `state` gave instead of what was added."""
        self._merged, *self._waiting = (_Sums(**part) for part in state["parts"])
        self._windows = state["windows"]

    def __len__(self) -> int:
        """Voxels merged so far."""
        return len(self._merged.keys)

    def cloud(self, min_windows: int = 1) -> tuple[PointCloud, NDArray[np.int32]]:
        """The mean point and colour of every voxel that at least so many windows have a point in.

        Beside the cloud, (N,) how many windows saw each point.
        """
        self._merge()
        chosen = self._merged.windows >= min_windows
        merged = self._merged
        means = merged.sums[chosen] / merged.points[chosen, None]
        corner = self._cells(merged.keys[chosen]) * self._voxel_m
        colours = np.rint(means[:, 3:]).astype(np.uint8)
        return PointCloud(corner + means[:, :3], colours), merged.windows[chosen]

    def _merge(self) -> None:
        if self._waiting:
            self._merged, self._waiting = _Sums.joined([self._merged, *self._waiting]), []

    def _keys(self, cell: NDArray[np.float64]) -> NDArray[np.int64]:
        if far := farthest(cell):
            raise InputError(
                f"a point {far * self._voxel_m:.3g} m from the origin does not "
                f"fit voxels of {self._voxel_m:g} m: choose larger voxels, or limit the depth"
            )
        return cell_keys(cell)

    @staticmethod
    def _cells(keys: NDArray[np.int64]) -> NDArray[np.float64]:
        mask = (1 << _BITS) - 1
        columns = ((keys >> shift) & mask for shift in (2 * _BITS, _BITS, 0))
        return np.stack([column - _HALF for column in columns], axis=1).astype(np.float64)


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums over the points of each voxel.

    Attributes:
        keys: (V,) int64, increasing; see `VoxelCloud`.
        sums: (V, 6) float64: position in the voxel, m, then red, green, blue.
        points: (V,) int64.
        windows: (V,) int32 windows that have a point there.
    """

    keys: NDArray[np.int64]
    sums: NDArray[np.float64]
    points: NDArray[np.int64]
    windows: NDArray[np.int32]

    @classmethod
    def joined(cls, parts: list[_Sums]) -> _Sums:
        """Adds up what belongs to the same voxel."""
        keys = np.concatenate([part.keys for part in parts])
        order = np.argsort(keys, kind="stable")
        unique, starts = np.unique(keys[order], return_index=True)
        if not len(unique):
            return parts[0]
        columns = ("sums", "points", "windows")
        values = (np.concatenate([getattr(part, name) for part in parts]) for name in columns)
        return cls(unique, *(np.add.reduceat(column[order], starts, axis=0) for column in values))
