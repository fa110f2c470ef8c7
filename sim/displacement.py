"""How far pixels move from one pose to another, from their depth."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from emvs.geometry import se3
from emvs.geometry.camera import Camera
from emvs.geometry.rig import Rig
from sim.lens import bearing_steps
from sim.pixel_kernels import squared_displacement, squared_displacement_lens


@lru_cache(maxsize=16)
def _lens_tables(camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    bearing, slope = bearing_steps(camera)
    return bearing.astype(np.float32), np.linalg.inv(slope).astype(np.float32)


def _fill_rows(
    camera: Camera,
    depth_m: NDArray[np.float32],
    T_b_a: NDArray[np.float64],
    rows: NDArray[np.float64],
) -> None:
    if camera.model == "pinhole":
        focal_px = np.array([camera.fx_px, camera.fy_px])
        centre_px = np.array([camera.cx_px, camera.cy_px])
        squared_displacement(depth_m, focal_px, centre_px, T_b_a, rows)
    else:
        squared_displacement_lens(depth_m, *_lens_tables(camera), T_b_a, rows)


def largest_displacement_px(
    rig: Rig,
    depths_m: Sequence[NDArray[np.float32]],
    T_world_body_a: NDArray[np.float64],
    T_world_body_b: NDArray[np.float64],
) -> float:
    """Returns the furthest that any pixel of any camera moves from pose a to pose b, px.

    Args:
        rig: cameras of any model.
        depths_m: per camera, (H, W) z-depth seen from pose a, m; inf where there is no surface.
        T_world_body_a: (4, 4) pose of the body that the depths belong to.
        T_world_body_b: (4, 4) the other pose.

    Returns:
        px; inf if a visible point is not in front of its camera any more.
    """
    T_b_a = se3.inverse(T_world_body_b) @ T_world_body_a
    largest = 0.0
    for camera, depth_m, T_body_cam in zip(rig.cameras, depths_m, rig.T_body_cam, strict=True):
        rows = np.empty(camera.height_px)
        _fill_rows(camera, depth_m, se3.inverse(T_body_cam) @ T_b_a @ T_body_cam, rows)
        largest = max(largest, float(rows.max()))
    return float(np.sqrt(largest))
