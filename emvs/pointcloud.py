"""Depth maps to point clouds: back-projection, radius filter, PLY."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs.depthmap import DepthMap
from emvs.geometry import se3
from emvs.open3d_library import open3d
from emvs.utils.files import atomic_path

ColourBy = Literal["depth", "confidence"]


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
    return PointCloud(points_world, _colours(depth_map, rows, columns, colour_by))


def without_outliers(cloud: PointCloud, radius_m: float, neighbours: int) -> PointCloud:
    """Drops points that have fewer than `neighbours` other points within `radius_m`.

    Raises:
        InputError: open3d cannot be loaded.
    """
    if neighbours == 0 or len(cloud) == 0:
        return cloud
    o3d = open3d()
    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points_world))
    # open3d counts the point itself, and wants more than nb_points
    _, kept = points.remove_radius_outlier(nb_points=neighbours, radius=radius_m)
    chosen = np.asarray(kept, np.int64)
    return PointCloud(cloud.points_world[chosen], cloud.colours[chosen])


def write_ply(path: Path, cloud: PointCloud, windows: NDArray[np.int32] | None = None) -> None:
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
    with atomic_path(path) as partial, partial.open("wb") as file:
        file.write("\n".join(header).encode("ascii"))
        file.write(vertices.tobytes())


def _colours(
    depth_map: DepthMap, rows: NDArray[np.intp], columns: NDArray[np.intp], colour_by: ColourBy
) -> NDArray[np.uint8]:
    if colour_by == "depth":
        values = np.reciprocal(depth_map.depth_m[rows, columns])
        low, high = float(depth_map.rho.min()), float(depth_map.rho.max())
    else:
        values = depth_map.confidence[rows, columns]
        low, high = 0.0, float(depth_map.confidence.max())
    return _palette(values, low, high)


def depth_colours(depth_m: NDArray[np.float32], near_m: float, far_m: float) -> NDArray[np.uint8]:
    """(..., 3) red, green, blue of depths: red near, blue far, even in inverse depth."""
    return _palette(np.reciprocal(depth_m), 1 / far_m, 1 / near_m)


def _palette(values: NDArray[np.floating], low: float, high: float) -> NDArray[np.uint8]:
    grey = np.rint(255 * np.clip((values - low) / (high - low), 0, 1)).astype(np.uint8)
    palette = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_TURBO)
    red_green_blue = palette[:, 0, ::-1].astype(np.uint8)
    colours: NDArray[np.uint8] = red_green_blue[grey]
    return colours
