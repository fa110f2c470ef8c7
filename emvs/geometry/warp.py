"""Carries a depth map from one pinhole view into another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry.camera import Camera

_MOST_RADIUS_PX = 32


def turn_depth(
    depth_m: NDArray[np.float32],
    source: Camera,
    target: Camera,
    R_target_source: NDArray[np.float64],
) -> NDArray[np.float32]:
    """As `move_depth`, between views of one place: `R_target_source` is a (3, 3) rotation."""
    T_target_source = np.eye(4)
    T_target_source[:3, :3] = R_target_source
    return move_depth(depth_m, source, target, T_target_source)


def move_depth(
    depth_m: NDArray[np.float32],
    source: Camera,
    target: Camera,
    T_target_source: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Projects every pixel's point into another pinhole view and keeps the nearest per pixel.

    Args:
        depth_m: (H, W) z-depth in the source view, m; not finite or not above 0 where unknown.
        source: its camera.
        target: the camera of the result.
        T_target_source: (4, 4) rigid motion between the two.

    Returns:
        (H, W) z-depth in the target view, m, NaN where no source pixel lands.
    """
    rows, columns = np.nonzero(np.isfinite(depth_m) & (depth_m > 0))
    bearing = source.unproject(np.stack([columns, rows], axis=-1).astype(np.float64))
    z_m = depth_m[rows, columns].astype(np.float64)
    points = np.column_stack([bearing, np.ones(len(bearing))]) * z_m[:, None]
    return nearest_depth(points @ T_target_source[:3, :3].T + T_target_source[:3, 3], target)


def nearest_depth(
    points_m: NDArray[np.float64], view: Camera, radius_m: float = 0.0
) -> NDArray[np.float32]:
    """Depth of (N, 3) points in a pinhole view's frame, or of discs that face the camera.

    Returns:
        (H, W) float32 z-depth of the nearest at each pixel, m, NaN where there is none.
    """
    seen = points_m[points_m[:, 2] > radius_m]
    uv = view.project(seen)
    good = (np.abs(uv) < 1e6).all(axis=1)
    uv_px, z_m = np.rint(uv[good]).astype(np.int64), seen[good, 2].astype(np.float32)
    reach_px = np.minimum(view.fx_px * radius_m / seen[good, 2], _MOST_RADIUS_PX).astype(np.int64)
    out = np.full((view.height_px, view.width_px), np.inf, np.float32)
    for reach in np.unique(reach_px).tolist():
        _stamp(out, uv_px[reach_px == reach], z_m[reach_px == reach], reach)
    return np.where(np.isfinite(out), out, np.nan).astype(np.float32)


def _stamp(
    out: NDArray[np.float32], centre_px: NDArray[np.int64], z_m: NDArray[np.float32], reach: int
) -> None:
    height, width = out.shape
    for dv in range(-reach, reach + 1):
        for du in range(-reach, reach + 1):
            u, v = centre_px[:, 0] + du, centre_px[:, 1] + dv
            on = (u >= 0) & (u < width) & (v >= 0) & (v < height)
            if du * du + dv * dv <= reach * reach:
                np.minimum.at(out, (v[on], u[on]), z_m[on])


def undistort_depth(depth_m: NDArray[np.float32], camera: Camera) -> NDArray[np.float32]:
    """(H, W) z-depth, m, in `camera.undistorted()` from z-depth at the sensor's pixels."""
    return reproject_depth(depth_m, camera, camera.undistorted())


def reproject_depth(
    depth_m: NDArray[np.float32], camera: Camera, target: Camera
) -> NDArray[np.float32]:
    """(H, W) z-depth, m, at the pixels of another camera in the same place and pose.

    Each pixel takes that of the nearest one; NaN off the camera that has the depth.
    """
    if camera == target:
        return depth_m
    uv = camera.project(target.ray_table())
    uv_px = np.rint(np.where(np.abs(uv) < 1e6, uv, -1)).astype(np.int64)
    inside = (
        (uv_px >= 0).all(axis=-1)
        & (uv_px[..., 0] < camera.width_px)
        & (uv_px[..., 1] < camera.height_px)
    )
    at = np.where(inside[..., None], uv_px, 0)
    return np.where(inside, depth_m[at[..., 1], at[..., 0]], np.nan).astype(np.float32)
