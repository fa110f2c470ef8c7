"""A mesh from the depth maps of many windows: truncated signed distances, averaged in voxels.

Each depth map says how far every voxel lies before or behind the surface that it saw (Curless and
Levoy, SIGGRAPH 1996); the mesh is where the average is zero. open3d keeps voxel blocks only where
there are surfaces, so memory grows with the surface and not with the number of windows.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.plugins import extra_module

_BLOCK_VOXELS, _FIRST_BLOCKS = 8, 10_000
_LIBRARIES = (
    "install its system libraries, on Debian: "
    "apt-get install libegl1 libgl1 libx11-6 libusb-1.0-0 libudev1 libidn2-0 libgomp1"
)
_CHANNELS = (("tsdf", (1,)), ("weight", (1,)), ("color", (3,)))


class SurfaceFusion:
    """Averages the signed distances of any number of dense depth maps.

    Distances count up to `truncation_voxels` from a surface: more than the noise of the depth, less
    than the thinnest object.

    Raises:
        InputError: open3d cannot be loaded.
    """

    def __init__(self, voxel_m: float, truncation_voxels: float = 4.0) -> None:
        self._o3d = load_open3d()
        self._truncation_voxels = truncation_voxels
        core = self._o3d.core
        names, shapes = zip(*_CHANNELS, strict=True)
        self._grid = self._o3d.t.geometry.VoxelBlockGrid(
            names, (core.float32,) * len(names), shapes, voxel_m, _BLOCK_VOXELS, _FIRST_BLOCKS,
            core.Device("CPU:0"),
        )  # fmt: skip

    def add(
        self,
        depth_m: NDArray[np.float32],
        mask: NDArray[np.bool_],
        colours: NDArray[np.uint8],
        camera: Camera,
        T_world_rv: NDArray[np.float64],
    ) -> None:
        """Adds one depth map, where (H, W) `mask` is set, with (H, W, 3) red, green, blue.

        A surface comes only of neighbouring pixels, so fill its gaps first.
        """
        if not mask.any():
            return
        # open3d takes a depth of 0 for none.
        depth = self._image(np.where(mask, depth_m, np.float32(0)))
        tensor = self._o3d.core.Tensor
        K, T_rv_world = tensor(camera.K), tensor(se3.inverse(T_world_rv))
        # depth in metres, none of it too far
        scale = 1.0, 2 * float(depth_m[mask].max()), self._truncation_voxels
        blocks = self._grid.compute_unique_block_coordinates(depth, K, T_rv_world, *scale)
        self._grid.integrate(blocks, depth, self._image(colours / 255), K, K, T_rv_world, *scale)

    def mesh(self, smallest_part: int = 1) -> Any:
        """The surface as an open3d triangle mesh with normals, less its smaller connected parts."""
        if self._grid.hashmap().size() == 0:
            return self._o3d.geometry.TriangleMesh()
        mesh = self._grid.extract_triangle_mesh(weight_threshold=1.0).to_legacy()
        if smallest_part > 1 and len(mesh.triangles):
            part, sizes, _ = mesh.cluster_connected_triangles()
            mesh.remove_triangles_by_mask(np.asarray(sizes)[np.asarray(part)] < smallest_part)
            mesh.remove_unreferenced_vertices()
        colours = np.asarray(mesh.vertex_colors).clip(0, 1)
        mesh.vertex_colors = self._o3d.utility.Vector3dVector(colours)
        mesh.compute_vertex_normals()
        return mesh

    def _image(self, pixels: NDArray[Any]) -> Any:
        values = np.ascontiguousarray(pixels, np.float32)
        return self._o3d.t.geometry.Image(self._o3d.core.Tensor(values))


def write_mesh(path: Path, mesh: Any) -> None:
    """Writes a mesh as a binary PLY, whole or not at all.

    Raises:
        InputError: an empty mesh, open3d cannot be loaded, or the folder cannot be written to.
        OSError: the file could not be written.
    """
    if len(mesh.triangles) == 0:
        raise InputError("no surface found: lower mesh_part, raise voxel_m, or leave mesh out")
    with atomic_path(path) as partial:
        if not load_open3d().io.write_triangle_mesh(str(partial), mesh, write_ascii=False):
            raise OSError(f"{path}: the mesh could not be written")


def load_open3d() -> Any:
    """The library, or an `InputError` that says why it cannot be loaded."""
    needed = "meshes and conversions of point clouds need open3d"
    return extra_module("open3d", needed, "mesh", f"; {_LIBRARIES}")
