"""Pictures of a scene through any camera of a rig: linear intensity and metric depth."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.graphics import current_driver, open_context
from eventsweep.sim.rendering import box_kernels, lens, pixel_kernels
from eventsweep.sim.rendering.base import Frame, Pose, Samples
from eventsweep.sim.rendering.draw_target import Colours, DrawTarget, sharpen_textures
from eventsweep.sim.rendering.drawn_geoms import DrawnGeoms
from eventsweep.sim.rendering.fine_light import FineLight, KernelLight
from eventsweep.sim.rendering.light_shader import NoShader, ShaderLight
from eventsweep.sim.rendering.model_renderer import ModelRenderer, metric_depth
from eventsweep.sim.rendering.sub_views import LensMap, SubView


class StereoRenderer(ModelRenderer):
    """Renders a static scene with MuJoCo's classic renderer, shadows and reflections off.

    Each picture sets the OpenGL frustum from the calibrated intrinsics, which is exact for any
    principal point and for unequal focal lengths. What the renderer calls colour is taken as linear
    radiance, so lighting and textures mean what their numbers say.
    """

    def __init__(self, *scene: Any, shader: bool | None = None, **settings: Any) -> None:
        """Compiles the scene and opens a graphics context.

        Args:
            scene: see `ModelRenderer`.
            shader: work the light of fine frames out in a shader; None for where a GPU draws and
                can.
            settings: see `ModelRenderer`.

        Raises:
            InputError: no graphics, a lens without a ray for a pixel, a scene that does not
                compile, or a shader that was asked for and cannot be had.
        """
        super().__init__(*scene, **settings)
        self._gl = open_context(*self._buffer_px)
        self._open_parts = ExitStack()
        self._open_parts.callback(self._gl.free)
        try:
            self._open(*self._buffer_px, self._floats, shader)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Frees the graphics context."""
        # Another renderer of this thread may be at work, and has objects of the same numbers.
        with self._gl.as_current():
            self._open_parts.close()

    @property
    def description(self) -> str:
        """What renders, for a sequence's manifest: MuJoCo, back end, and what OpenGL says draws."""
        back_end = type(self._gl).__module__.rsplit(".", 1)[-1]
        kind = "classic in float" if self._target.floats else "classic"
        light = f", {self._light.by}" if self._light.by else ""
        return f"mujoco {self._mj.__version__} {kind}{light}, {back_end}: {self._driver.identity}"

    def _moved(self) -> None:
        super()._moved()
        self._drawn.updated()

    def near_first(self, T_world_body: Pose) -> None:
        """Draws what is near before what it hides, seen from a pose (4, 4), until further notice.

        A hidden sample costs nothing. Where bodies move, nothing happens: they are put in place for
        every picture.
        """
        if self._animate is None:
            self._drawn.near_first(T_world_body[:3, 3])

    def frame(self, camera: int, T_world_body: Pose) -> Frame:
        """Renders what `camera` sees from `T_world_body` (4, 4), averaged over the samples."""
        if self._fine:
            return self._fine_frame(camera, T_world_body)
        seen, mapped = self.rig.cameras[camera], self._lenses[camera]
        intensity = np.empty((seen.height_px, seen.width_px), np.float32)
        nearest = np.empty_like(intensity)
        full_scale = self._target.full_scale
        if mapped is None:
            rgb, window_depth = self._draw(seen, camera, T_world_body, self.supersample)
            samples = self.supersample
            pixel_kernels.average(rgb, window_depth, samples, intensity, nearest, full_scale)
        else:
            rgb, window_depth = self._draw_lens(mapped, camera, T_world_body)
            luma = np.empty_like(window_depth)
            pixel_kernels.luma(rgb, full_scale, luma)
            pixel_kernels.resample(
                luma, window_depth, mapped.position, mapped.step, self._lens_samples,
                intensity, nearest,
            )  # fmt: skip
        return Frame(intensity, self._metric_depth(nearest, mapped))

    def glance(self, camera: int, T_world_body: Pose) -> Frame:
        """Light and depth (H, W) of one sample per pixel, through a pinhole."""
        seen = self.rig.cameras[camera]
        view = seen if seen.model == "pinhole" else seen.undistorted()
        rgb, window_depth = self._draw(view, camera, T_world_body)
        intensity = np.empty(window_depth.shape, np.float32)
        pixel_kernels.luma(rgb, self._target.full_scale, intensity)
        return Frame(intensity, metric_depth(window_depth, self._near_m, self._far_m))

    def _fine_frame(self, camera: int, T_world_body: Pose) -> Frame:
        view, n = self._views[camera], self.supersample
        samples = Samples(*(np.empty(view.samples_shape, np.float32) for _ in Samples._fields))
        clip_m = self._clip_m(view.lens)
        for picture in view.pictures():
            for part in picture.parts:
                self._render(part, camera, T_world_body, *picture.samples, clip_m)
            self._light.take(view, picture, samples)
        rho = samples.inverse_depth_per_m
        if view.lens is None:
            box_kernels.inverse_depth(rho, *clip_m)
        else:
            box_kernels.inverse_depth_in_lens(rho, n, view.lens.ratio, *clip_m)
        shape = view.sensor.height_px, view.sensor.width_px
        intensity, depth_m = np.empty(shape, np.float32), np.empty(shape, np.float32)
        box_kernels.nearest_of_pixels(rho, n, view.border_px, depth_m)
        box_kernels.pixel_means(samples.light, n, view.border_px, intensity)
        return Frame(intensity, depth_m, samples)

    def depth(
        self,
        camera: int,
        T_world_body: Pose,
        view: Camera | None = None,
        *,
        border: bool = False,
    ) -> NDArray[np.float32]:
        """Z-depth (H, W) at every pixel's centre, m; inf where there is no surface.

        With a pinhole `view`, that through it from the camera's place instead of through its own
        lens; with `border`, (H + 2 B, W + 2 B) of a fine frame.

        Raises:
            InputError: a view with distortion.
        """
        if view is not None and view.model != "pinhole":
            raise InputError(f"a view with {view.model} distortion: use its `.undistorted()`")
        mapped, seen = self._seen(camera, border)
        # The sky is drawn as a surface, but has no depth. Plain colours are soonest drawn, but
        # glass would have depth in them.
        with self._flags(SKYBOX=0, REFLECTION=0, SEGMENT=int(self._drawn.all_opaque)):
            if view is not None or mapped is None:
                window_depth = self._view_depth(view or seen, camera, T_world_body)
                return self._metric_depth(window_depth, None)
            self._draw_views(mapped, camera, T_world_body)
        samples = self._target.read_depth(*mapped.shape)
        window_depth = np.empty(mapped.position.shape[:2], np.float32)
        pixel_kernels.centre_depth(samples, mapped.position, window_depth)
        return self._metric_depth(window_depth, mapped)

    def segmentation(
        self, camera: int, T_world_body: Pose, *, border: bool = False
    ) -> NDArray[np.int32]:
        """Returns the geom id (H, W) at every pixel's centre; -1 where there is none.

        Through a distorting lens, that of the render sample nearest to the centre. With `border`,
        (H + 2 B, W + 2 B) of a fine frame.
        """
        mapped, seen = self._seen(camera, border)
        with self._flags(SEGMENT=1, IDCOLOR=1, REFLECTION=0):
            if mapped is None:
                rgb = self._draw(seen, camera, T_world_body)[0][::-1]
            else:
                rgb = lens.nearest_samples(mapped, self._draw_lens(mapped, camera, T_world_body)[0])
        if self._target.floats:
            rgb = np.rint(255 * rgb)
        segment = rgb.astype(np.int32) @ np.array([1, 1 << 8, 1 << 16], np.int32)
        geom_id = np.full(self._scene.ngeom + 1, -1, np.int32)
        kind = self._mj.mjtObj.mjOBJ_GEOM
        for geom in self._scene.geoms[: self._scene.ngeom]:
            # Of what is drawn, only the model's geoms are geoms; their order may be another.
            if geom.objtype == kind and 0 <= geom.segid < self._scene.ngeom:
                geom_id[geom.segid + 1] = geom.objid
        ids: NDArray[np.int32] = geom_id[segment]
        return ids

    def _open(self, width_px: int, height_px: int, floats: bool, shader: bool | None) -> None:
        mj = self._mj
        self._driver = current_driver()
        self._context = mj.MjrContext(self.model, mj.mjtFontScale.mjFONTSCALE_100)
        self._open_parts.callback(self._context.free)
        mirrors = bool(np.any(self.model.mat_reflectance))
        self._target = DrawTarget(
            self._context, width_px, height_px, floats=floats, stencil=mirrors
        )
        self._open_parts.callback(self._target.free)
        self._light = self._fine_light(shader)
        self._open_parts.callback(self._light.free)
        if self._fine:
            sharpen_textures(self._context, max(view.stride for view in self._views))
        mj.mjr_setBuffer(mj.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        for name in ("SHADOW", "REFLECTION", "HAZE", "FOG"):
            self._scene.flags[getattr(mj.mjtRndFlag, f"mjRND_{name}")] = 0
        # One mirror pass costs a whole picture: only for scenes that have something to mirror.
        self._scene.flags[mj.mjtRndFlag.mjRND_REFLECTION] = mirrors
        self._drawn = DrawnGeoms(self.model, self._scene)

    def _fine_light(self, shader: bool | None) -> FineLight:
        """What works the light out: a GPU by itself, a CPU by kernels."""
        wanted = self._driver.hardware if shader is None else shader
        if not (wanted and self._fine):
            return KernelLight(self._target)
        try:
            return ShaderLight(self._target, self._views)
        except NoShader as error:
            if shader:
                raise
            return KernelLight(self._target, f"light on the CPU, no shader can ({error.reason})")

    @contextmanager
    def _flags(self, **values: int) -> Iterator[None]:
        """Sets rendering flags, by name, for a while."""
        flags, kinds = self._scene.flags, self._mj.mjtRndFlag
        before = {name: flags[getattr(kinds, f"mjRND_{name}")] for name in values}
        try:
            for name, value in values.items():
                flags[getattr(kinds, f"mjRND_{name}")] = value
            yield
        finally:
            for name, value in before.items():
                flags[getattr(kinds, f"mjRND_{name}")] = value

    def _view_depth(self, view: Camera, camera: int, T_world_body: Pose) -> NDArray[np.float32]:
        """Window depth at the view's pixel centres, top row first, in tiles where it is large."""
        window_depth = np.empty((view.height_px, view.width_px), np.float32)
        for tile, rows, columns in lens.tiles(view, *self._buffer_px):
            self._render(SubView(tile), camera, T_world_body, 1, 1, self._clip_m(None))
            part = self._target.read_depth(tile.height_px, tile.width_px)
            window_depth[rows, columns] = part[::-1]
        return window_depth

    def _draw(
        self, view: Camera, camera: int, T_world_body: Pose, supersample: int = 1
    ) -> tuple[Colours, NDArray[np.float32]]:
        """Colour and window depth (1 near, 0 far) at the samples, bottom row first."""
        clip_m = self._clip_m(None)
        self._render(SubView(view), camera, T_world_body, supersample, supersample, clip_m)
        return self._target.read(view.height_px * supersample, view.width_px * supersample)

    def _draw_lens(
        self, mapped: LensMap, camera: int, T_world_body: Pose
    ) -> tuple[Colours, NDArray[np.float32]]:
        """The same of all sub-views, side by side; what lies between them is undefined."""
        self._draw_views(mapped, camera, T_world_body)
        return self._target.read(*mapped.shape)

    def _draw_views(self, mapped: LensMap, camera: int, T_world_body: Pose) -> None:
        for part in mapped.views:
            self._render(part, camera, T_world_body, 1, 1, self._clip_m(mapped))

    def _render(
        self, part: SubView, camera: int, T_world_body: Pose, along: int, down: int,
        clip_m: tuple[float, float],
    ) -> None:  # fmt: skip
        """Draws a view with so many samples per pixel along a row and down a column."""
        self._gl.make_current()
        T_world_view = T_world_body @ self.rig.T_body_cam[camera]
        if part.R_cam_view is not None:
            T_world_view[:3, :3] = T_world_view[:3, :3] @ part.R_cam_view
        self._place(part.camera, T_world_view, *clip_m)
        self._drawn.only_seen(part.camera, T_world_view)
        T_world_lamp = self._T_world_lamp(T_world_body)
        for lamp in self._head_lamps:
            lamp.pos, lamp.dir = T_world_lamp[:3, 3], T_world_lamp[:3, 2]
        size = part.camera.width_px * along, part.camera.height_px * down
        self._mj.mjr_render(self._mj.MjrRect(*part.corner, *size), self._scene, self._context)

    def _place(self, camera: Camera, T_world_cam: Pose, near_m: float, far_m: float) -> None:
        """Sets pose and frustum of both eyes; the one place where z forward becomes -z."""
        left, right, top, bottom = near_m * lens.edges(camera)
        for eye in self._scene.camera:
            eye.pos, eye.forward = T_world_cam[:3, 3], T_world_cam[:3, 2]
            eye.up = -T_world_cam[:3, 1]
            eye.frustum_center, eye.frustum_width = (left + right) / 2, (right - left) / 2
            eye.frustum_top, eye.frustum_bottom = -top, -bottom
            eye.frustum_near, eye.frustum_far = near_m, far_m
