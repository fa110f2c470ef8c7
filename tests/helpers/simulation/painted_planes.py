"""Textured planes of which every picture is known by formula: the continuous world, for tests.

A plane z = depth (world axes: those of the first camera) carries light that is a sum of waves. What
a pixel sees of it, the mean over its square, is worked out by quadrature on rays; nothing is
rendered, and no formula is shared with the simulator.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.compensation.fine_frame import FineFrame
from eventsweep.sim.rendering.base import Frame, Samples

_WAVES = np.array(
    [[9.0, 2.0, 0.4], [-4.0, 7.0, 1.9], [13.0, -5.0, 0.8], [3.0, 11.0, 2.7], [6.0, 6.0, 5.1]]
)
"""Angular frequency by x and y, rad/m, and phase, of waves on a plane 2 m away."""


@dataclass(frozen=True)
class Plane:
    """Light on z = `depth_m`, which may drift sideways, m/s."""

    depth_m: float
    drift_m_s: tuple[float, float] = (0.0, 0.0)

    def light(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64], t_s: float):
        """Between 0.1 and 0.9."""
        x, y = x_m - self.drift_m_s[0] * t_s, y_m - self.drift_m_s[1] * t_s
        scale = 2.0 / self.depth_m
        waves = [np.sin(scale * (a * x + b * y) + c) for a, b, c in _WAVES]
        return 0.5 + 0.4 * np.mean(waves, axis=0)


def seen(
    plane: Plane, T_world_cam: NDArray[np.float64], t_s: float, rays: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Light and z-depth along rays (..., 3), whose z is 1."""
    directions = rays @ T_world_cam[:3, :3].T
    depth_m = (plane.depth_m - T_world_cam[2, 3]) / directions[..., 2]
    points = T_world_cam[:3, 3] + depth_m[..., None] * directions
    return plane.light(points[..., 0], points[..., 1], t_s), depth_m


def rays_through(camera: Camera, columns, rows) -> NDArray[np.float64]:
    """The rays (N, M, 3) through a grid of sensor positions."""
    uv_px = np.stack(np.meshgrid(columns, rows), -1).astype(float)
    return np.concatenate([camera.unproject(uv_px), np.ones((*uv_px.shape[:-1], 1))], -1)


@lru_cache(maxsize=8)  # a lens is undone once, not at every time
def _quadrature(camera: Camera, border_px: int, grid: int):
    """Gauss's rule, 3 x 3, on a pixel's square: weights, and rays around all places of a grid."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    rows = np.arange(grid * (camera.height_px + 2 * border_px - 1) + 1) / grid - border_px
    columns = np.arange(grid * (camera.width_px + 2 * border_px - 1) + 1) / grid - border_px
    return [
        (wu * wv, rays_through(camera, columns + du, rows + dv))
        for dv, wv in zip(nodes / 2, weights / 2, strict=True)
        for du, wu in zip(nodes / 2, weights / 2, strict=True)
    ]


def pixel_light(plane, camera, T_world_cam, t_s, border_px=0, grid=1):
    """Mean light over a pixel's square around every place of a grid."""
    total = 0.0
    for weight, rays in _quadrature(camera, border_px, grid):
        total = total + weight * seen(plane, T_world_cam, t_s, rays)[0]
    return total.astype(np.float32)


def fine_frame(plane, camera, T_world_cam, t_s, *, border_px, grid, reach_px):
    """The fine frame that a perfect renderer would draw."""
    columns, rows = (
        (np.arange(grid * (size + 2 * border_px)) + 0.5) / grid - border_px - 0.5
        for size in (camera.width_px, camera.height_px)
    )
    light, depth_m = seen(plane, T_world_cam, t_s, rays_through(camera, columns, rows))
    return sampled_frame(light, 1 / depth_m, border_px, grid, reach_px)


def sampled_frame(light, inverse_depth_per_m, border_px, grid, reach_px):
    """The fine frame of some samples."""
    samples = Samples(light.astype(np.float32), inverse_depth_per_m.astype(np.float32))
    rows, columns = (size // grid for size in light.shape)
    inner = slice(border_px, rows - border_px), slice(border_px, columns - border_px)
    of_pixels = (part.reshape(rows, grid, columns, grid) for part in samples)
    intensity, nearest = (next(of_pixels).mean((1, 3)), next(of_pixels).max((1, 3)))
    with np.errstate(divide="ignore"):
        depth_m = 1 / nearest[inner]
    return FineFrame(Frame(intensity[inner].copy(), depth_m, samples), grid, reach_px)


def pose(shift_m=(0.0, 0.0, 0.0), turn_deg=(0.0, 0.0, 0.0)):
    """(4, 4) `T_world_cam`: turned by a rotation vector, then moved."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix()
    T[:3, 3] = shift_m
    return T
