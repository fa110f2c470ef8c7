"""One pinhole picture of a scene: what its samples see, and in which light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.plugins.raster.shading_kernels import planes, shade
from eventsweep.plugins.raster.surfaces import Surfaces
from eventsweep.plugins.raster.visibility_kernels import visible
from eventsweep.sim.rendering.lens import edges

Array = NDArray[np.float64]
# Balls around geoms are taken larger by a share of their radius and distance, for rounding.
_MARGIN = 1e-6


class Grid(NamedTuple):
    """Where a picture's samples lie.

    Attributes:
        camera: a pinhole, in pixels.
        samples: per pixel and axis.
        stride: rows that lie beside one another, see `fine_light.FineView.stride`.
        upside_down: whether the bottom row comes first.
        corner: column and row of the first sample.
    """

    camera: Camera
    samples: int = 1
    stride: int = 1
    upside_down: bool = False
    corner: tuple[int, int] = (0, 0)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of samples."""
        return self.samples * self.camera.height_px, self.samples * self.camera.width_px

    @property
    def intrinsics(self) -> Array:
        """(4,) fx, fy, cx, cy in samples; upside down fy is negative."""
        camera, n, (rows, _) = self.camera, self.samples, self.shape
        c_x, c_y = (n * (c + 0.5) - 0.5 for c in (camera.cx_px, camera.cy_px))
        f_y = n * camera.fy_px
        if self.upside_down:
            f_y, c_y = -f_y, rows - 1 - c_y
        return np.array([n * camera.fx_px, f_y, c_x + self.corner[0], c_y + self.corner[1]])

    @property
    def view(self) -> NDArray[np.int64]:
        """(4,) first and last column, first and last row."""
        (rows, columns), (left, top) = self.shape, self.corner
        return np.array([left, left + columns - 1, top, top + rows - 1])


class Buffers:
    """What pictures are drawn into, and memory for what they see; as large as the largest was."""

    def __init__(self, triangles: int) -> None:
        self._ids = np.empty(0, np.int32)
        self.edges = np.empty((triangles + 1, 3, 3))
        self.source = np.empty(triangles + 1, np.int64)
        self.rho = np.empty((triangles + 1, 3))
        self.light = np.empty((triangles + 1, 3, 3))
        self.places = np.empty((triangles + 1, 3, 3))

    def ids(self, shape: tuple[int, int]) -> NDArray[np.int32]:
        """(H, W) for numbers of triangles."""
        size = shape[0] * shape[1]
        if self._ids.size < size:
            self._ids = np.empty(size, np.int32)
        return self._ids[:size].reshape(shape)


class Painter:
    """Draws pictures of surfaces, one after the other."""

    def __init__(self, surfaces: Surfaces) -> None:
        self._surfaces, self._buffers = surfaces, Buffers(len(surfaces.corners))
        self._order = np.arange(len(surfaces.geoms.ids))
        geoms = surfaces.geoms
        # The sky is one geom more.
        self._texture = np.append(geoms.texture, surfaces.sky)
        self._channels = np.append(geoms.channels, 1)

    def near_first(self, eye_m: Array) -> None:
        """Draws geoms in the order of their distance from an eye (3,), m, until further notice."""
        geoms, poses = self._surfaces.geoms, self._surfaces.poses
        local = np.einsum("gji,gj->gi", poses[:, :, :3], eye_m - poses[:, :, 3])
        away = np.abs(local - geoms.middle)
        nearest = np.sqrt((np.maximum(away - geoms.half, 0) ** 2).sum(1))
        farthest = np.sqrt(((away + geoms.half) ** 2).sum(1))
        distance_m = np.where(np.isfinite(geoms.radius_m), (nearest + farthest) / 2, np.inf)
        self._order = np.argsort(distance_m, kind="stable")

    def draw(
        self, grid: Grid, T_world_view: Array, clip_m: tuple[float, float],
        nearness: NDArray[np.float32], scale: tuple[float, float] = (1.0, 0.0),
    ) -> tuple[NDArray[np.int32], int]:  # fmt: skip
        """Fills `nearness` with scale[0] / z - scale[1], 0 where nothing is.

        Args:
            grid: where samples lie in `nearness`.
            T_world_view: (4, 4).
            clip_m: nearest and farthest depth.
            nearness: in and out, (H, W), 0 where nothing was drawn.
            scale: see above.

        Returns:
            Numbers of the triangles seen, of the same shape, and how many there are.
        """
        surfaces, memory = self._surfaces, self._buffers
        ids, view = memory.ids(nearness.shape), grid.view
        ids[view[2] : view[3] + 1, view[0] : view[1] + 1] = -1
        made = visible(
            surfaces.corners, surfaces.geoms.first, self._seen(grid.camera, T_world_view),
            se3.inverse(T_world_view), grid.intrinsics, grid.stride, view, np.array(clip_m),
            np.array(scale), nearness, ids, memory.edges, memory.source,
        )  # fmt: skip
        return ids, made

    def paint(
        self, grid: Grid, T_world_view: Array, T_world_lamp: Array, ids: NDArray[np.int32],
        made: int, bias: float, light: NDArray[np.float32],
    ) -> None:  # fmt: skip
        """Fills `light` of the picture drawn last; a `bias` below 0 makes textures sharper."""
        surfaces, memory = self._surfaces, self._buffers
        surfaces.shine(T_world_view, T_world_lamp)
        planes(
            made, memory.edges, memory.source, surfaces.light, surfaces.places, memory.rho,
            memory.light, memory.places,
        )  # fmt: skip
        owner = np.append(surfaces.owner[memory.source[:made]], len(surfaces.geoms.ids))
        nothing = self._sky(made, grid, T_world_view) if surfaces.sky >= 0 else -1
        shade(
            ids, owner, self._texture, self._channels, memory.rho, memory.light, memory.places,
            *surfaces.texels, grid.stride, grid.view, bias, nothing, light,
        )  # fmt: skip

    def geom_ids(self, ids: NDArray[np.int32], made: int) -> NDArray[np.int32]:
        """Geoms of the model that numbers of triangles belong to; -1 for none."""
        surfaces = self._surfaces
        owner = surfaces.owner[self._buffers.source[:made]]
        found: NDArray[np.int32] = np.append(surfaces.geoms.ids[owner], -1).astype(np.int32)[ids]
        return found

    def _sky(self, number: int, grid: Grid, T_world_view: Array) -> int:
        """Makes the sky a triangle of that number: its texture lies in the samples' directions."""
        f_x, f_y, c_x, c_y = grid.intrinsics
        turn, memory = T_world_view[:3, :3], self._buffers
        direction = np.column_stack([turn[:, 0] / f_x, turn[:, 1] / f_y, turn[:, 2]])
        direction[:, 2] -= direction[:, 0] * c_x + direction[:, 1] * c_y
        memory.rho[number] = memory.light[number] = 0, 0, 1
        memory.places[number] = direction[[0, 2, 1]] * [[1], [1], [-1]]
        return number

    def _seen(self, camera: Camera, T_world_view: Array) -> NDArray[np.int64]:
        """The geoms that reach into a pinhole view, in order."""
        left, right, top, bottom = edges(camera)
        inwards = np.array([[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]])
        inwards /= np.sqrt((inwards**2).sum(1, keepdims=True))
        geoms, poses = self._surfaces.geoms, self._surfaces.poses
        middle_m = np.einsum("gij,gj->gi", poses[:, :, :3], geoms.middle) + poses[:, :, 3]
        from_eye = middle_m - T_world_view[:3, 3]
        distance_m = np.sqrt((from_eye**2).sum(1))
        reach_m = geoms.radius_m + _MARGIN * (geoms.radius_m + distance_m)
        inside_m = from_eye @ T_world_view[:3, :3] @ inwards.T
        order: NDArray[np.int64] = self._order[(inside_m.min(1) >= -reach_m)[self._order]]
        return order
