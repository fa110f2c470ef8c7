"""Cameras at a time, depth carried between them, and what one sees of what another shows.

Every pixel with depth is a facet: a piece of its surface, one pixel large, whose slope is that of
its neighbours on the same surface. Facets are drawn into the other view with their perspective; the
nearest stays. So depth keeps its gaps and its discontinuities, whatever the two sizes of pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.plugins.align import views_kernels

Array = NDArray[np.float64]
SAME_SURFACE = 0.02
"""Inverse depths that differ by less than this share belong to one surface."""
_CORNERS = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
_BAND_ROWS = 64


@dataclass(frozen=True, eq=False)
class View:
    """A camera at a time: its lens, and (4, 4) `T_world_cam`."""

    camera: Camera
    T_world_cam: Array

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.camera.height_px, self.camera.width_px

    def seen(self, points: Array, scale: Array | None = None) -> tuple[Array, Array]:
        """Projects homogeneous points of the world.

        Args:
            points: (..., 3) the points times `scale`.
            scale: (...) 0 for directions to points at infinity; by default 1.

        Returns:
            (..., 2) pixels, NaN off the lens's field of view or behind the camera; and (...)
            inverse depth, 1/m.
        """
        factor = np.ones(points.shape[:-1]) if scale is None else scale
        T_cam_world = se3.inverse(self.T_world_cam)
        inside = points @ T_cam_world[:3, :3].T + factor[..., None] * T_cam_world[:3, 3]
        z = inside[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.hypot(inside[..., 0], inside[..., 1]) > _reach(self.camera) * z
            rho = factor / z
        uv_px = self.camera.project(np.where((off | (z <= 0))[..., None], np.nan, inside))
        return uv_px, rho

    def rays(self, bearing: Array) -> Array:
        """(..., 3) directions in the world of bearings (..., 2), their z in the camera 1."""
        rays = np.concatenate([bearing, np.ones((*bearing.shape[:-1], 1))], axis=-1)
        return rays @ self.T_world_cam[:3, :3].T

    def points(self, bearing: Array, rho: Array) -> Array:
        """(..., 3) homogeneous points of the world, times inverse depth (...)."""
        return self.rays(bearing) + rho[..., None] * self.T_world_cam[:3, 3]


@lru_cache(maxsize=8)
def bearings(camera: Camera) -> Array:
    """(H, W, 2) bearings of all pixels; read only."""
    table = camera.bearing_table()
    table.setflags(write=False)
    return table


@lru_cache(maxsize=8)
def _corner_bearings(camera: Camera) -> Array:
    columns, rows = np.meshgrid(np.arange(camera.width_px + 1), np.arange(camera.height_px + 1))
    return camera.unproject(np.stack([columns, rows], axis=-1) - 0.5)


@lru_cache(maxsize=16)
def _reach(camera: Camera) -> float:
    """No pixel's bearing is longer: beyond it a lens's polynomial may fold back."""
    edge = _corner_bearings(camera)
    return float(np.nanmax(np.hypot(edge[..., 0], edge[..., 1]), initial=0.0))


def carried(depths: list[tuple[Array, View]], view: View) -> Array:
    """(H, W) inverse depth in a view, of what others know; below 0 where nothing is known.

    Each of `depths` is (H, W) inverse depth, below 0 where unknown, and its view.
    """
    out = np.full(view.shape, -1.0)
    for rho, source in depths:
        slope = np.empty((*rho.shape, 2))
        views_kernels.slopes(rho, SAME_SURFACE, slope)
        corners = _corner_bearings(source.camera)
        for first in range(0, len(rho), _BAND_ROWS):
            some = slice(first, first + _BAND_ROWS)
            rows, columns = np.nonzero(rho[some] >= 0)
            rows += first
            ends = np.rint(_CORNERS + 0.5).astype(np.int64)
            bearing = corners[rows[:, None] + ends[:, 1], columns[:, None] + ends[:, 0]]
            change = slope[rows, columns] @ _CORNERS.T
            corner_rho = np.maximum(rho[rows, columns, None] + change, 0.0)
            uv_px, seen_rho = view.seen(source.points(bearing, corner_rho), corner_rho)
            views_kernels.draw(uv_px, seen_rho, out)
    return out


def shown_in(
    view: View, rho: Array, picture: NDArray[np.float32], taken: View, taken_rho: Array
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """What a view sees of a picture that another camera took.

    Args:
        view: whose pixels the result has.
        rho: (H, W) inverse depth there, below 0 where unknown.
        picture: (H, W) of the other camera.
        taken: that camera when it took the picture.
        taken_rho: (H, W) inverse depth that it saw.

    Returns:
        (H, W) values, 0 where nothing is seen, and (H, W) mask: see `views_kernels`.
    """
    smooth = as_large(picture, taken.camera, view.camera)
    uv_px, seen_rho = view_places(view, rho, taken)
    value, mask = np.empty(rho.size, np.float32), np.empty(rho.size, np.uint8)
    views_kernels.look_up(
        uv_px.reshape(-1, 2), seen_rho.ravel(), taken_rho, smooth, SAME_SURFACE, value, mask
    )
    return value.reshape(rho.shape), mask.reshape(rho.shape)


def view_places(view: View, rho: Array, other: View) -> tuple[Array, Array]:
    """Where another camera sees every pixel's point: (H, W, 2) pixels and (H, W) inverse depth.

    Inverse depth is below 0 where `rho` is.
    """
    known = np.where(rho >= 0, rho, 0.0)
    uv_px, seen_rho = other.seen(view.points(bearings(view.camera), known), known)
    return uv_px, np.where(rho >= 0, np.maximum(seen_rho, 0.0), -1.0)


def as_large(picture: NDArray[np.float32], fine: Camera, coarse: Camera) -> NDArray[np.float32]:
    """The picture as pixels of the other camera's size would see it, where those are larger."""
    ratio = fine.fx_px / coarse.fx_px
    if ratio <= 1:
        return picture
    sigma_px = float(np.sqrt((ratio**2 - 1) / 12))  # of boxes: their variances add up
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px), np.float32)


def known_depth_m(rho: Array) -> NDArray[np.float32]:
    """(H, W) z-depth, m; NaN where unknown, inf at infinity."""
    with np.errstate(divide="ignore"):
        return np.where(rho >= 0, 1 / np.abs(rho), np.nan).astype(np.float32)


def inverse(depth_m: NDArray[np.float32], *, sky: bool = False) -> Array:
    """Inverse depth, below 0 where a depth is unknown; with `sky`, inf is infinitely far."""
    deep = depth_m.astype(np.float64)
    known = (deep > 0) & (np.isfinite(deep) | sky)
    return np.where(known, 1 / np.where(known, deep, 1.0), -1.0)
