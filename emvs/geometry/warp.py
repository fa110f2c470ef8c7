"""Carries a depth map from one pinhole view into another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.geometry.camera import Camera


def turn_depth(
    depth_m: NDArray[np.float32],
    source: Camera,
    target: Camera,
    R_target_source: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Projects every pixel into the target and keeps the nearest surface per pixel.

    Args:
        depth_m: (H, W) z-depth in the source view, m; not finite or not above 0 where unknown.
        source: its pinhole camera.
        target: the pinhole camera of the result.
        R_target_source: (3, 3) rotation between the two.

    Returns:
        (H, W) z-depth in the target view, m, NaN where no source pixel lands.
    """
    T_target_source = np.eye(4)
    T_target_source[:3, :3] = R_target_source
    return move_depth(depth_m, source, target, T_target_source)


def move_depth(
    depth_m: NDArray[np.float32],
    source: Camera,
    target: Camera,
    T_target_source: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Projects every pixel's point into another view and keeps the nearest surface per pixel.

    Args:
        depth_m: (H, W) z-depth in the source view, m; not finite or not above 0 where unknown.
        source: its pinhole camera.
        target: the pinhole camera of the result.
        T_target_source: (4, 4) rigid motion between the two.

    Returns:
        (H, W) z-depth in the target view, m, NaN where no source pixel lands.
    """
    rows, columns = np.nonzero(np.isfinite(depth_m) & (depth_m > 0))
    bearing = source.unproject(np.stack([columns, rows], axis=-1).astype(np.float64))
    z_m = depth_m[rows, columns].astype(np.float64)
    points = np.column_stack([bearing, np.ones(len(bearing))]) * z_m[:, None]
    points = points @ T_target_source[:3, :3].T + T_target_source[:3, 3]
    uv = target.project(points)
    good = (np.abs(uv) < 1e6).all(axis=1) & (points[:, 2] > 0)
    uv_px, z_m = np.rint(uv[good]).astype(np.int64), points[good, 2]
    inside = (
        (uv_px[:, 0] >= 0)
        & (uv_px[:, 1] >= 0)
        & (uv_px[:, 0] < target.width_px)
        & (uv_px[:, 1] < target.height_px)
    )
    out = np.full((target.height_px, target.width_px), np.inf)
    np.minimum.at(out, (uv_px[inside, 1], uv_px[inside, 0]), z_m[inside])
    return np.where(np.isfinite(out), out, np.nan).astype(np.float32)


def undistort_depth(depth_m: NDArray[np.float32], camera: Camera) -> NDArray[np.float32]:
    """Looks up z-depth of the distorted sensor for each pixel of the undistorted view.

    Args:
        depth_m: (H, W) z-depth at the sensor's pixels, m.
        camera: the sensor with its lens.

    Returns:
        (H, W) z-depth in `camera.undistorted()`, of the nearest sensor pixel; NaN off the sensor.
    """
    if camera.model == "pinhole":
        return depth_m
    return _looked_up(depth_m, camera.undistorted().bearing_table(), camera)


def distort_depth(depth_m: NDArray[np.float32], camera: Camera) -> NDArray[np.float32]:
    """Looks up z-depth of the undistorted view for each pixel of the distorted sensor.

    Args:
        depth_m: (H, W) z-depth in `camera.undistorted()`, m.
        camera: the sensor with its lens.

    Returns:
        (H, W) z-depth at the sensor's pixels, of the nearest one of the view; NaN off the view.
    """
    if camera.model == "pinhole":
        return depth_m
    return _looked_up(depth_m, camera.bearing_table(), camera.undistorted())


def _looked_up(
    depth_m: NDArray[np.float32], bearing: NDArray[np.float64], camera: Camera
) -> NDArray[np.float32]:
    """Depth as a camera has it at the pixels nearest to bearings; a view of the same place."""
    uv = camera.project(np.concatenate([bearing, np.ones((*bearing.shape[:2], 1))], axis=-1))
    uv_px = np.rint(np.where(np.abs(uv) < 1e6, uv, -1)).astype(np.int64)
    inside = (
        (uv_px >= 0).all(axis=-1)
        & (uv_px[..., 0] < camera.width_px)
        & (uv_px[..., 1] < camera.height_px)
    )
    at = np.where(inside[..., None], uv_px, 0)
    return np.where(inside, depth_m[at[..., 1], at[..., 0]], np.nan).astype(np.float32)
