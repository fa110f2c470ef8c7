"""Pixels from render samples, and how far they move, in plain numpy."""

import numpy as np

from eventsweep.emvs.geometry import se3


def average(rgb, window_depth, supersample):
    """Mean luma (H, W), 0 to 1, and largest window depth, top row first."""
    height, width = (n // supersample for n in window_depth.shape)
    blocks = (height, supersample, width, supersample)
    luma = rgb[::-1].astype(float) @ [0.2126, 0.7152, 0.0722] / 255
    return luma.reshape(blocks).mean((1, 3)), window_depth[::-1].reshape(blocks).max((1, 3))


def displacements_px(rig, depths_m, T_world_body_a, T_world_body_b):
    """Per camera, (H, W) distance between each pixel and where its surface point goes."""
    moved = []
    for camera, depth_m, T_body_cam in zip(rig.cameras, depths_m, rig.T_body_cam, strict=True):
        u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
        far_m = np.where(np.isfinite(depth_m), depth_m, 1e9).astype(float)
        bearing = camera.unproject(np.stack([u, v], -1))
        points_a = np.dstack([bearing, np.ones_like(far_m)]) * far_m[..., None]
        points_world = se3.transform(T_world_body_a @ T_body_cam, points_a)
        points_b = se3.transform(se3.inverse(T_world_body_b @ T_body_cam), points_world)
        moved.append(np.linalg.norm(camera.project(points_b) - np.stack([u, v], -1), axis=-1))
    return moved
