"""A scene's pictures through any camera of a rig, drawn without a graphics library."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.plugins.raster.picture import Drawn, Grid, Look, Painter
from eventsweep.plugins.raster.surfaces import Surfaces
from eventsweep.sim.rendering import box_kernels, pixel_kernels
from eventsweep.sim.rendering.base import Frame, Pose, Samples
from eventsweep.sim.rendering.draw_target import LOD_BIAS
from eventsweep.sim.rendering.lens import nearest_samples
from eventsweep.sim.rendering.model_renderer import ModelRenderer, metric_depth
from eventsweep.sim.rendering.sub_views import LensMap

Image = NDArray[np.float32]
# Rows of a sub-view that lie beside one another: samples see the nearest of its triangles.
_SUB_STRIDE = 4


class RasterRenderer(ModelRenderer):
    """Renders a model by compiled loops; see `ModelRenderer` for its arguments."""

    def __init__(self, *scene: Any, **settings: Any) -> None:
        """Compiles the scene."""
        super().__init__(*scene, **settings)
        self._surfaces = Surfaces(self.model, self._scene, floats=self._floats)
        self._painter = Painter(self._surfaces)
        self._bias = 0.0
        if self._fine:
            self._bias = LOD_BIAS - math.log2(max(view.stride for view in self._views))

    def close(self) -> None:
        """Nothing is held."""

    @property
    def description(self) -> str:
        """What renders, for a sequence's manifest."""
        return f"raster, mujoco {self._mj.__version__}{' in float' if self._floats else ''}"

    def _moved(self) -> None:
        self._surfaces.move(self._data)

    def near_first(self, T_world_body: Pose) -> None:
        """Draws what is near, seen from a pose (4, 4), before what it hides, from now on."""
        if self._animate is None:
            self._painter.near_first(T_world_body[:3, 3])

    def frame(self, camera: int, T_world_body: Pose) -> Frame:
        """Renders what `camera` sees from `T_world_body` (4, 4), averaged over the samples."""
        view, n = self._views[camera], self.supersample
        if view.lens is not None and not self._fine:
            return self._plain_in_lens(view.lens, camera, T_world_body)
        samples = self._samples_in_lens(camera, T_world_body)
        if samples is None:
            grid = Grid(view.drawn, n, view.stride if self._fine else 1)
            samples = Samples(*self._lit(grid, camera, T_world_body))
        shape = view.sensor.height_px, view.sensor.width_px
        intensity, depth_m = np.empty(shape, np.float32), np.empty(shape, np.float32)
        box_kernels.nearest_of_pixels(samples.inverse_depth_per_m, n, view.border_px, depth_m)
        box_kernels.pixel_means(samples.light, n, view.border_px, intensity)
        return Frame(intensity, depth_m, samples if self._fine else None)

    def glance(self, camera: int, T_world_body: Pose) -> Frame:
        """Light and depth (H, W) of one sample per pixel, through a pinhole."""
        seen = self.rig.cameras[camera]
        view = seen if seen.model == "pinhole" else seen.undistorted()
        light, rho = self._lit(Grid(view), camera, T_world_body)
        return Frame(light, _depth_m(rho))

    def depth(
        self,
        camera: int,
        T_world_body: Pose,
        view: Camera | None = None,
        *,
        border: bool = False,
    ) -> Image:
        """Z-depth (H, W) at every pixel's centre, m; inf where there is no surface.

        With a pinhole `view`, that through it from the camera's place instead of through its own
        lens; with `border`, (H + 2 B, W + 2 B) of a fine frame.

        Raises:
            InputError: a view with distortion.
        """
        if view is not None and view.model != "pinhole":
            raise InputError(f"a view with {view.model} distortion: use its `.undistorted()`")
        mapped, seen = self._seen(camera, border)
        if view is not None or mapped is None:
            solid = self._surfaces.all_solid
            return _depth_m(self._drawn(Grid(view or seen), camera, T_world_body, solid).nearness)
        window, _ = self._in_views(mapped, camera, T_world_body)
        found = np.empty(mapped.position.shape[:2], np.float32)
        pixel_kernels.centre_depth(window, mapped.position, found)
        depth_m = metric_depth(found, *self._clip_m(mapped))
        return np.asarray(depth_m * mapped.ratio[..., 0])

    def segmentation(
        self, camera: int, T_world_body: Pose, *, border: bool = False
    ) -> NDArray[np.int32]:
        """Returns the geom id (H, W) at every pixel's centre; -1 where there is none.

        Through a distorting lens, that of the render sample nearest to the centre. With `border`,
        (H + 2 B, W + 2 B) of a fine frame.
        """
        mapped, seen = self._seen(camera, border)
        if mapped is None:
            return self._painter.geom_ids(self._drawn(Grid(seen), camera, T_world_body, True))
        geoms = np.full(mapped.shape, -1, np.int32)
        for grid, T_world_view in self._parts(mapped, camera, T_world_body):
            window = np.zeros(mapped.shape, np.float32)
            clip_m = self._clip_m(mapped)
            drawn = self._painter.draw(grid, T_world_view, clip_m, window, glass=True)
            left, right, top, bottom = grid.view
            geoms[top : bottom + 1, left : right + 1] = self._painter.geom_ids(drawn)
        found: NDArray[np.int32] = nearest_samples(mapped, geoms)
        return found

    def _drawn(self, grid: Grid, camera: int, T_world_body: Pose, glass: bool = False) -> Drawn:
        """A pinhole picture with 1/z, and the triangles that it sees."""
        T_world_view = T_world_body @ self.rig.T_body_cam[camera]
        rho = np.zeros(grid.shape, np.float32)
        return self._painter.draw(grid, T_world_view, self._clip_m(None), rho, glass=glass)

    def _lit(self, grid: Grid, camera: int, T_world_body: Pose) -> tuple[Image, Image]:
        """Light and 1/z of a pinhole picture."""
        drawn = self._drawn(grid, camera, T_world_body)
        light = np.empty_like(drawn.nearness)
        self._painter.paint(drawn, self._look(T_world_body), light)
        return light, drawn.nearness

    def _look(self, T_world_body: Pose) -> Look:
        return Look(self._T_world_lamp(T_world_body), self._bias)

    def _parts(
        self, mapped: LensMap, camera: int, T_world_body: Pose, stride: int = 1
    ) -> list[tuple[Grid, Pose]]:
        """The sub-views of a lens, and their poses."""
        T_world_cam, parts = T_world_body @ self.rig.T_body_cam[camera], []
        for part in mapped.views:
            T_world_view = T_world_cam.copy()
            if part.R_cam_view is not None:
                T_world_view[:3, :3] = T_world_cam[:3, :3] @ part.R_cam_view
            grid = Grid(part.camera, stride=stride, upside_down=True, corner=part.corner)
            parts.append((grid, T_world_view))
        return parts

    def _in_views(
        self, mapped: LensMap, camera: int, T_world_body: Pose, *, lit: bool = False
    ) -> tuple[Image, Image]:
        """Window depth of all sub-views, side by side; with `lit`, their light."""
        near_m, far_m = clip_m = self._clip_m(mapped)
        whole = 1 / near_m - 1 / far_m
        window = np.zeros(mapped.shape, np.float32)
        light = np.zeros(mapped.shape if lit else (0, 0), np.float32)
        for grid, T_world_view in self._parts(mapped, camera, T_world_body):
            scale = 1 / whole, 1 / far_m / whole
            glass = self._surfaces.all_solid and not lit
            drawn = self._painter.draw(grid, T_world_view, clip_m, window, scale, glass=glass)
            if lit:
                self._painter.paint(drawn, self._look(T_world_body), light)
        return window, light

    def _plain_in_lens(self, mapped: LensMap, camera: int, T_world_body: Pose) -> Frame:
        window, light = self._in_views(mapped, camera, T_world_body, lit=True)
        intensity = np.empty(mapped.position.shape[:2], np.float32)
        nearest = np.empty_like(intensity)
        pixel_kernels.resample(
            light, window, mapped.position, mapped.step, self._lens_samples, intensity, nearest
        )
        depth_m = metric_depth(nearest, *self._clip_m(mapped)) * mapped.ratio[..., 0]
        return Frame(intensity, depth_m)

    def _samples_in_lens(self, camera: int, T_world_body: Pose) -> Samples | None:
        """The samples of a fine frame behind a lens; None for a pinhole."""
        view, n = self._views[camera], self.supersample
        if view.lens is None:
            return None
        samples = Samples(*(np.empty(view.samples_shape, np.float32) for _ in Samples._fields))
        lens, rho = view.lens, samples.inverse_depth_per_m
        if self._painter.all_solid((T_world_body @ self.rig.T_body_cam[camera])[:3, 3]):
            parts = self._parts(lens, camera, T_world_body, _SUB_STRIDE)
            clip_m, look = self._clip_m(lens), self._look(T_world_body)
            self._painter.through_lens(lens, parts, clip_m, look, samples)
            return samples
        window, light = self._in_views(lens, camera, T_world_body, lit=True)
        pixel_kernels.resampled(light, window, lens.position, lens.step, n, *samples)
        box_kernels.inverse_depth_in_lens(rho, n, lens.ratio, *self._clip_m(lens))
        return samples


def _depth_m(rho: Image) -> Image:
    """Depth from 1/z; inf where that is 0."""
    with np.errstate(divide="ignore"):
        return np.asarray(1 / rho)
