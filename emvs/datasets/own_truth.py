"""Ground truth that a `recording.toml` names: depth maps at some times, or a surface."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from eventsweep.emvs.data.stamps import read_stamps
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.depth import read_depth, read_exr, read_png
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.geometry.warp import nearest_depth, undistort_depth
from eventsweep.emvs.parameters import FrozenModel, TimeUs
from eventsweep.emvs.utils.plugins import extra_module

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class TruthTable(FrozenModel):
    """The table `[truth]`: `depth` and `times`, or `surface`.

    Attributes:
        depth: pattern of depth maps of the first camera, such as `truth/*.png`, one per time, in
            the order of their names: 16-bit PNG, npy, npz (`depth_m`, `mask`) or EXR (channel Z).
        times: text with one time per line, or `time name`, in `time_unit`.
        time_offset_us: added to them.
        unit_m: what 1 counts in the maps or the surface, m; needed for whole numbers.
        kind: `z`, along the optical axis, or `distance`, along the ray.
        lens: `undistorted`, a pinhole view with the calibration's intrinsics, or `sensor`, the
            pixels as the lens gives them.
        surface: mesh or point cloud (PLY, OBJ, STL, PCD) in the world of the poses.
        point_radius_m: radius of a cloud's points: each hides what lies behind it.
    """

    depth: str = ""
    times: str = ""
    time_unit: Literal["s", "ms", "us", "ns"] = "s"
    time_offset_us: TimeUs = 0
    unit_m: Positive | None = None
    kind: Literal["z", "distance"] = "z"
    lens: Literal["undistorted", "sensor"] = "undistorted"
    surface: str = ""
    point_radius_m: Positive | None = None


def open_truth(
    folder: Path, table: TruthTable, rig: Rig, poses: Trajectory | str
) -> StoredTruth | SurfaceTruth | None:
    """Opens what `[truth]` names, below a folder; the rig's first camera is the one with truth.

    A surface shows no depth to a camera whose poses nobody knows: it is left out then.
    """
    if bool(table.depth) == bool(table.surface):
        raise InputError(f"{folder}: [truth] needs one of the keys depth or surface")
    if table.surface:
        if isinstance(poses, str):
            return None
        return SurfaceTruth(folder / table.surface, table, rig, poses)
    if not table.times:
        raise InputError(f"{folder}: [truth] needs the key times: text with one time per line")
    files = sorted(path for path in folder.glob(table.depth) if path.is_file())
    stamps = read_stamps(folder / table.times, table.time_unit)
    times_us, names = np.array(stamps.t_us, np.int64) + table.time_offset_us, stamps.names
    if not (np.diff(times_us) > 0).all():
        raise InputError(f"{folder / table.times}: times must increase from line to line")
    if names:
        by_name = {path.name: path for path in files}
        missing = [name for name in names if Path(name).name not in by_name]
        if missing:
            raise InputError(
                f"{folder / table.times}: no depth map {missing[0]!r} in {table.depth!r}"
            )
        files = [by_name[Path(name).name] for name in names]
    if len(files) != len(times_us) or not files:
        raise InputError(
            f"{folder}: {len(files)} depth maps {table.depth!r} for {len(times_us)} times in "
            f"{table.times}: needs one map per time"
        )
    return StoredTruth(times_us, files, table, rig.cameras[0])


class StoredTruth:
    """Depth maps in files; a `emvs.datasets.posed.DepthTruth`."""

    def __init__(
        self, t_us: NDArray[np.int64], files: list[Path], table: TruthTable, camera: Camera
    ) -> None:
        self.t_us = t_us
        self._files, self._table, self._camera = files, table, camera

    def view_depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in camera 0's undistorted view at one of the times, m; else NaN."""
        path, camera = self._files[int(np.searchsorted(self.t_us, t_us))], self._camera
        depth = _read_map(path, self._table.unit_m)
        if depth.shape != (camera.height_px, camera.width_px):
            raise InputError(
                f"{path}: {depth.shape[1]} x {depth.shape[0]} px, but the camera has "
                f"{camera.width_px} x {camera.height_px}: give maps of the first camera's size"
            )
        seen = camera if self._table.lens == "sensor" else camera.undistorted()
        if self._table.kind == "distance":
            bearing = seen.bearing_table()
            depth = (depth / np.sqrt(1 + np.sum(bearing * bearing, axis=-1))).astype(np.float32)
        return undistort_depth(depth, camera) if self._table.lens == "sensor" else depth


class SurfaceTruth:
    """A mesh or a cloud, seen from wherever the poses are; a `emvs.datasets.posed.DepthTruth`."""

    any_time = True

    def __init__(self, path: Path, table: TruthTable, rig: Rig, trajectory: Trajectory) -> None:
        if not path.is_file():
            raise InputError(f"{path}: no such file; needs a mesh or a point cloud")
        self._path, self._trajectory, self._rig = path, trajectory, rig
        self._unit_m, self._radius_m = table.unit_m or 1.0, table.point_radius_m
        self._cast: Callable[[Camera, NDArray[np.float64]], NDArray[np.float32]] | None = None
        self.t_us = np.asarray(trajectory.t_us)

    def view_depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in camera 0's undistorted view at a time that the poses cover, m."""
        if self._cast is None:
            self._cast = self._opened()
        T_world_cam = self._trajectory.at([t_us])[0] @ self._rig.T_body_cam[0]
        return self._cast(self._rig.cameras[0].undistorted(), T_world_cam)

    def _opened(self) -> Callable[[Camera, NDArray[np.float64]], NDArray[np.float32]]:
        o3d = extra_module("open3d", f"{self._path}: truth from a surface needs open3d", "mesh")
        mesh = o3d.io.read_triangle_mesh(str(self._path))
        if len(mesh.triangles):
            mesh.vertices = o3d.utility.Vector3dVector(np.asarray(mesh.vertices) * self._unit_m)
            scene = o3d.t.geometry.RaycastingScene()
            scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(mesh))
            return lambda view, T_world_cam: _depth_of_mesh(o3d, scene, view, T_world_cam)
        points = np.asarray(o3d.io.read_point_cloud(str(self._path)).points) * self._unit_m
        if not len(points) or not np.isfinite(points).all():
            raise InputError(f"{self._path}: neither a mesh nor a point cloud with finite points")
        if self._radius_m is None:
            raise InputError(
                f"{self._path}: a point cloud; set the key point_radius_m to about the distance "
                "between its points, so that near points hide what lies behind"
            )
        radius_m = self._radius_m
        return lambda view, T_world_cam: depth_of_points(points, radius_m, view, T_world_cam)


def depth_of_points(
    points_m: NDArray[np.float64], radius_m: float, view: Camera, T_world_cam: NDArray[np.float64]
) -> NDArray[np.float32]:
    """(H, W) z-depth in a view, m, of discs around (N, 3) points of the world; else NaN."""
    return nearest_depth(se3.transform(se3.inverse(T_world_cam), points_m), view, radius_m)


def _depth_of_mesh(
    o3d: Any, scene: Any, view: Camera, T_world_cam: NDArray[np.float64]
) -> NDArray[np.float32]:
    rays = view.ray_table()
    origin = np.broadcast_to(T_world_cam[:3, 3], rays.shape)
    both = np.concatenate([origin, rays @ T_world_cam[:3, :3].T], axis=-1).astype(np.float32)
    # A ray whose z in the camera is 1 is met after as many of its lengths as the depth has metres.
    depth_m = scene.cast_rays(o3d.core.Tensor(np.ascontiguousarray(both)))["t_hit"].numpy()
    return np.where(np.isfinite(depth_m), depth_m, np.nan).astype(np.float32)


def _read_map(path: Path, unit_m: float | None) -> NDArray[np.float32]:
    """(H, W) depth in m, NaN where unknown."""
    if path.suffix.lower() == ".exr":
        channels = read_exr(path)
        depth = next((channels[name] for name in "ZYR" if name in channels), None)
        if depth is None:
            raise InputError(f"{path}: channels {', '.join(channels) or 'none'}; needs Z")
        return _known(depth, unit_m or 1.0)
    if path.suffix.lower() != ".png":
        return np.asarray(read_depth(path) * np.float32(unit_m or 1.0))
    image = read_png(path)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise InputError(f"{path}: {image.ndim}D {image.dtype}; needs one channel of 16 bits")
    if unit_m is None:
        raise InputError(
            f"{path}: integer depths; set the key unit_m: 0.001 for millimetres, 0.0002 for TUM "
            "RGB-D"
        )
    return _known(image.astype(np.float64), unit_m)


def _known(values: NDArray[Any], unit_m: float) -> NDArray[np.float32]:
    return np.where(np.isfinite(values) & (values > 0), values * unit_m, np.nan).astype(np.float32)
