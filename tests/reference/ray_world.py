"""A world of textured panels and its pictures by ray casting: the simulator's independent truth.

Panels are rectangles (or parallelograms) in ambient light; each may drift at a constant speed. What
a pixel sees is the mean of samples spread over its square, each the texture where its ray meets the
nearest panel. Nothing here is shared with the renderer or the compensation, lenses included.

Axes are those of cameras: x right, y down, z forward. Pixel centres lie at integer coordinates.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Pose = Callable[[float], Array]
"""From a time, s, to `T_world_cam` (4, 4)."""
Vector = tuple[float, float, float]
_BISECTIONS, _FIXED_POINTS = 60, 200
_EDGE_ON = 1e-12
"""m³: a panel whose plane holds the camera's centre is not seen."""


@dataclass(frozen=True, eq=False)
class Panel:
    """A textured parallelogram that is seen from both sides.

    Attributes:
        centre_m: its middle at the start.
        across_m: from the middle to the middle of the edge at the texture's last column.
        down_m: from the middle to the middle of the edge at the texture's last row.
        texture: (H, W) uint8 grey.
        velocity_m_s: its own motion.
        repeats: how often the texture lies side by side, in both directions.
    """

    centre_m: Vector
    across_m: Vector
    down_m: Vector
    texture: NDArray[np.uint8]
    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    repeats: float = 1.0

    @property
    def moves(self) -> bool:
        """Whether it moves by itself."""
        return any(self.velocity_m_s)


@dataclass(frozen=True)
class RayCamera:
    """A sensor behind a lens: `pinhole`, `radtan` (k1, k2, p1, p2) or `kb4` (k1 to k4)."""

    width_px: int
    height_px: int
    focal_px: float
    cx_px: float
    cy_px: float
    model: str = "pinhole"
    distortion: tuple[float, ...] = ()

    def rays(self, uv_px: Array) -> Array:
        """The (..., 2) bearings x/z, y/z of the light that falls on (..., 2) sensor positions."""
        seen = (uv_px - (self.cx_px, self.cy_px)) / self.focal_px
        if self.model == "radtan":
            return _without_radtan(seen, self.distortion)
        return _without_kb4(seen, self.distortion) if self.model == "kb4" else seen

    def positions(self, points_m: Array) -> Array:
        """Where (..., 3) points before the camera, in its axes, are seen: (..., 2), px."""
        seen = points_m[..., :2] / points_m[..., 2:]
        if self.model == "radtan":
            seen = _radtan(seen, self.distortion)
        elif self.model == "kb4":
            radius = np.hypot(seen[..., :1], seen[..., 1:])
            seen = seen * _kb4(np.arctan(radius), self.distortion) / np.maximum(radius, 1e-12)
        return self.focal_px * seen + (self.cx_px, self.cy_px)


def _kb4(angle: Array, terms: tuple[float, ...]) -> Array:
    """The distance from the middle, in focal lengths, at which light of an angle falls."""
    return angle * (1 + sum(k * angle ** (2 * n) for n, k in enumerate(terms, start=1)))


def _without_kb4(seen: Array, terms: tuple[float, ...]) -> Array:
    """Bisection on the angle, from the axis to a right angle."""
    radius = np.hypot(seen[..., :1], seen[..., 1:])
    low, high = np.zeros_like(radius), np.full_like(radius, math.pi / 2)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        beyond = _kb4(middle, terms) > radius
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return seen * np.tan(low) / np.maximum(radius, 1e-12)


def _radtan(bearing: Array, terms: tuple[float, ...]) -> Array:
    """Brown's model, as OpenCV writes it."""
    k1, k2, p1, p2 = terms
    x, y = bearing[..., 0], bearing[..., 1]
    square = x * x + y * y
    radial = 1 + k1 * square + k2 * square**2
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def _without_radtan(seen: Array, terms: tuple[float, ...]) -> Array:
    """The fixed point of taking off what the lens adds."""
    bearing = seen
    for _ in range(_FIXED_POINTS):
        bearing = bearing + seen - _radtan(bearing, terms)
    return bearing


@dataclass(frozen=True, eq=False)
class RayWorld:
    """Panels, and a camera that moves among them.

    Attributes:
        panels: what there is to see; where there is none, it is dark.
        camera: the sensor and its lens.
        T_world_cam: its pose (4, 4) by time, s.
        ambient: light on all panels: the intensity of a white one.
    """

    panels: tuple[Panel, ...]
    camera: RayCamera
    T_world_cam: Pose
    ambient: float = 1.0

    def inverse_panels(self, t_s: float) -> Array:
        """(K, 3, 3) matrices that carry a ray (x, y, 1) to (a, b, 1) / depth on each panel.

        A ray of z-depth d meets the plane where d (x, y, 1) = centre + a across + b down. All zeros
        for a panel that is seen edge on.
        """
        T_world_cam = self.T_world_cam(t_s)
        R, out = T_world_cam[:3, :3], np.zeros((len(self.panels), 3, 3))
        for panel, inverse in zip(self.panels, out, strict=True):
            centre_m = np.add(panel.centre_m, np.multiply(t_s, panel.velocity_m_s))
            columns = [panel.across_m, panel.down_m, centre_m - T_world_cam[:3, 3]]
            matrix = R.T @ np.array(columns, float).T
            if abs(np.linalg.det(matrix)) > _EDGE_ON:
                inverse[:] = np.linalg.inv(matrix)
        return out


def sample_rays(camera: RayCamera, samples: int, seed: int = 7) -> Array:
    """Rays (H * W, S * S, 2) spread over each pixel's square.

    One lies in each of S x S squares, and one in each of S² columns and S² rows, so that an upright
    edge that passes over a pixel changes it in S² equal steps.
    """
    rng, pixels = np.random.default_rng(seed), camera.width_px * camera.height_px
    order = np.tile(np.arange(samples), (pixels, samples, 1))
    cell = np.arange(samples)
    x = (cell[:, None] + (rng.permuted(order, axis=2) + 0.5) / samples) / samples - 0.5
    y = (cell[:, None] + (rng.permuted(order, axis=2) + 0.5) / samples) / samples - 0.5
    offsets = np.stack([x, y.transpose(0, 2, 1)], -1).reshape(pixels, -1, 2)
    rows, columns = np.divmod(np.arange(pixels), camera.width_px)
    return camera.rays(np.stack([columns, rows], -1)[:, None] + offsets)


class RayCaster:
    """Pictures of a world, S x S samples per pixel."""

    def __init__(self, world: RayWorld, samples: int) -> None:
        self.world = world
        self._rays = sample_rays(world.camera, samples)
        textures = [panel.texture for panel in world.panels]
        self._texels = np.concatenate([texture.ravel() for texture in textures]) / 255.0
        starts = np.cumsum([0, *(texture.size for texture in textures)])[:-1]
        self._tables = np.array([(*texture.shape, start) for texture, start in
                                 zip(textures, starts, strict=True)])  # fmt: skip
        self._repeats = np.array([panel.repeats for panel in world.panels], float)

    def picture(self, t_s: float) -> Array:
        """Linear intensity (H, W) at a time, s."""
        light = np.empty(len(self._rays))
        panels = self.world.inverse_panels(t_s)
        _cast(self._rays, panels, self._texels, self._tables, self._repeats, light)
        camera = self.world.camera
        return self.world.ambient * light.reshape(camera.height_px, camera.width_px)


@nb.njit(cache=True)
def _cast(rays, panels, texels, tables, repeats, out):
    """Mean over each pixel's rays of what the nearest panel shows."""
    for pixel in range(rays.shape[0]):
        total = 0.0
        for sample in range(rays.shape[1]):
            x, y = rays[pixel, sample]
            k, a, b = _nearest(x, y, panels)
            if k >= 0:
                u, v = (0.5 * a + 0.5) * repeats[k], (0.5 * b + 0.5) * repeats[k]
                total += _texture(texels, tables[k], u, v)
        out[pixel] = total / rays.shape[1]


@nb.njit(cache=True)
def _nearest(x, y, panels):
    """The nearest panel on a ray, -1 for none, and where on it: -1 to 1, across and down."""
    found, found_a, found_b, inverse_depth = -1, 0.0, 0.0, 0.0
    for k in range(len(panels)):
        inverse = panels[k]
        near = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]
        if near <= inverse_depth:
            continue
        a = (inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) / near
        b = (inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) / near
        if abs(a) <= 1 and abs(b) <= 1:
            found, found_a, found_b, inverse_depth = k, a, b, near
    return found, found_a, found_b


@nb.njit(cache=True)
def _texture(texels, table, u, v):
    """Between four texel centres, the texture repeating itself; u and v count repetitions."""
    height, width, start = table
    x, y = u * width - 0.5, v * height - 0.5
    column, row = math.floor(x), math.floor(y)
    right, below = x - column, y - row
    value = 0.0
    for down in range(2):
        for across in range(2):
            share = (right if across else 1 - right) * (below if down else 1 - below)
            j, i = (column + across) % width, (row + down) % height
            value += share * texels[start + i * width + j]
    return value
