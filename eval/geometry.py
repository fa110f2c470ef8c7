"""Where points fall on a sensor, as indices of its image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.geometry.camera import Camera

Floats = NDArray[np.float64]
Pixels = NDArray[np.int64]
Flags = NDArray[np.bool_]


def pixel_of(camera: Camera, points_cam: Floats) -> tuple[Pixels, Pixels, Flags]:
    """Finds the sensor's pixel of each point: (N,) row, column, and whether there is one.

    Where there is none, row and column are 0, so that they can index an image.
    """
    uv_px = np.nan_to_num(np.rint(camera.project(points_cam)), nan=-1.0)
    column, row = np.clip(uv_px, -1, 1e9).astype(np.int64).T
    inside = (column >= 0) & (row >= 0) & (column < camera.width_px) & (row < camera.height_px)
    return np.where(inside, row, 0), np.where(inside, column, 0), inside
