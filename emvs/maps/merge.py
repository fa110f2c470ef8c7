"""Joins the windows of a map folder to one cloud and one mesh, a window at a time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from eventsweep.emvs.config import FuseConfig
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.inpainting import inpaint
from eventsweep.emvs.depth.point_cloud import (
    VoxelCloud,
    back_project_map,
    palette,
    without_outliers,
    write_ply,
)
from eventsweep.emvs.depth.tsdf import SurfaceFusion, write_mesh
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.maps.folder import StoredMap
from eventsweep.emvs.parameters import FrozenModel
from eventsweep.emvs.utils.outputs import atomic_dir
from eventsweep.emvs.utils.runtime import Progress, silent

FOLDER = "global"
_PREFERRED = "Alg1/H"


class FusedInfo(FrozenModel):
    """What was made, as `fuse.json` says it."""

    method: str
    config: FuseConfig
    windows: int
    window_points: int
    points: int
    vertices: int | None = None
    triangles: int | None = None


def chosen_method(stored: StoredMap, method: str | None) -> str:
    """The method asked for; by default harmonic-mean fusion, else the first that was mapped."""
    if not stored.windows:
        raise InputError(f"{stored.path}: holds no window yet; map until one is finished")
    known = stored.windows[0].info.methods
    if method is not None and method not in known:
        raise InputError(f"{stored.path}: no method {method!r}, it has {', '.join(known)}")
    return method or (_PREFERRED if _PREFERRED in known else known[0])


def fuse_windows(
    stored: StoredMap,
    config: FuseConfig,
    method: str | None = None,
    progress: Progress = silent,
) -> tuple[Path, FusedInfo]:
    """Writes `MAP/global/<method>/cloud.ply`, `mesh.ply` on request, and `fuse.json`, anew.

    `progress` is called with `fuse`, the windows done and all.

    Returns:
        The folder, and what is in it.

    Raises:
        InputError: see `chosen_method`; damaged files; no voxel with enough windows.
    """
    method = chosen_method(stored, method)
    mapped = stored.info.config
    voxels, window_points = VoxelCloud(config.voxel_m), 0
    surface = None
    if config.mesh:
        surface = SurfaceFusion(config.voxel_m, config.mesh_truncation)
    for k, window in enumerate(stored.windows):
        progress("fuse", k, len(stored.windows))
        depth_map = window.depth_map(method)
        cloud = back_project_map(depth_map)
        cloud = without_outliers(cloud, mapped.radius_m, mapped.radius_neighbours)
        window_points += len(cloud)
        voxels.add(cloud)
        if surface is not None:
            _add(surface, depth_map)
    progress("fuse", len(stored.windows), len(stored.windows))
    cloud, windows = voxels.cloud(config.min_windows)
    _check_any(stored, len(cloud), window_points, config)
    facts: dict[str, Any] = {
        "method": method, "config": config, "windows": len(stored.windows),
        "window_points": window_points, "points": len(cloud),
    }  # fmt: skip
    folder = stored.path / FOLDER / file_name(method)
    with atomic_dir(folder, force=True, part_of=stored.path) as partial:
        write_ply(partial / "cloud.ply", cloud, windows)
        if surface is not None:
            mesh = surface.mesh(config.mesh_part)
            write_mesh(partial / "mesh.ply", mesh)
            facts |= {"vertices": len(mesh.vertices), "triangles": len(mesh.triangles)}
        info = FusedInfo(**facts)
        text = info.model_dump_json(indent=2, exclude_none=True)
        (partial / "fuse.json").write_text(text + "\n", encoding="utf-8")
    return folder, info


def _add(surface: SurfaceFusion, depth_map: DepthMap) -> None:
    dense = inpaint(depth_map)
    near_m, far_m = float(1 / depth_map.rho.max()), float(1 / depth_map.rho.min())
    # Pixels without depth may hold anything; their colour is never used.
    rho = np.reciprocal(dense.depth_m.clip(near_m, far_m))
    colours = palette(rho, 1 / far_m, 1 / near_m)
    mask = dense.measured | dense.filled
    surface.add(dense.depth_m, mask, colours, depth_map.camera, depth_map.T_world_rv)


def _check_any(stored: StoredMap, points: int, window_points: int, config: FuseConfig) -> None:
    if points == 0:
        raise InputError(
            f"{stored.path}: {window_points} points in {len(stored.windows)} windows, no voxel of "
            f"{config.voxel_m:g} m with points of {config.min_windows}: lower min_windows or raise "
            "voxel_m"
        )
