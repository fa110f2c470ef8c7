"""Pictures of a scene through any camera of a rig: linear intensity and metric depth."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.tables import Geom
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.geoms import enclosing_geom, geom_table
from eventsweep.sim.graphics import current_driver, import_mujoco, open_context
from eventsweep.sim.mjcf import compiled
from eventsweep.sim.motion import Animation
from eventsweep.sim.rendering import box_kernels, lens, pixel_kernels
from eventsweep.sim.rendering.base import Frame, Pose, Samples
from eventsweep.sim.rendering.draw_target import Colours, DrawTarget, sharpen_textures
from eventsweep.sim.rendering.drawn_geoms import DrawnGeoms
from eventsweep.sim.rendering.fine_light import FineLight, FineView, KernelLight
from eventsweep.sim.rendering.light_shader import NoShader, ShaderLight
from eventsweep.sim.rendering.sub_views import LensMap, SubView

if TYPE_CHECKING:
    import mujoco

# Samples per pixel and axis where depth and geoms are looked up through a distorting lens: at
# least, and with fine frames at most. Only edges gain by more: they lie wrong by half a sample.
_LEAST_LENS_SAMPLES, _MOST_LENS_SAMPLES = 2, 3
# When moving bodies are looked at to tell one animation from another: evenly, and early.
# How much farther a look goes that asks what the farther clipping plane hides.
_FAR = 1000
_IDENTITY_SAMPLES, _EARLY_S = 32, (0.001, 0.01, 0.1)


class StereoRenderer:
    """Renders a static scene with MuJoCo's classic renderer, shadows and reflections off.

    The cameras are not part of the MuJoCo model: each picture sets the OpenGL frustum from the
    calibrated intrinsics, which is exact for any principal point and for unequal focal lengths.
    A camera with distortion is resampled from pinhole pictures of its parts, see
    `sim.rendering.sub_views`. What the renderer calls colour is taken as linear radiance, so
    lighting and textures mean what their numbers say. MuJoCo's headlight is a lamp on the body, the
    same for all cameras. A renderer belongs to the thread that made it.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec | mujoco.MjModel,
        rig: Rig,
        supersample: int = 1,
        depth_range_m: tuple[float, float] = (0.1, 50.0),
        *,
        floats: bool = False,
        animate: Animation | None = None,
        border_px: int | None = None,
        shader: bool | None = None,
        clip_m: tuple[float, float] | None = None,
        lamp_at: Pose | None = None,
        carrier: str = "",
    ) -> None:
        """Compiles the scene and opens a graphics context.

        Args:
            spec: the scene, to be compiled or compiled; a copy of it is used.
            rig: cameras and their places on the body.
            supersample: samples per pixel and axis.
            depth_range_m: the clipping planes lie at half its near and four times its far end.
            floats: draw light in floating point, without steps and without end.
            animate: moves the bodies that move by themselves; see `at`.
            border_px: makes fine frames: with the light between the pixels, textures sharp, and so
                many pixels beyond the sensor's edge, as far as its lens has rays there.
            shader: work the light of fine frames out in a shader; None for where a GPU draws and
                can.
            clip_m: where the clipping planes lie instead.
            lamp_at: (4, 4) where the headlight stays; by default it goes with the body.
            carrier: the body that carries the rig: cameras may lie inside its geoms.

        Raises:
            InputError: no graphics, a lens without a ray for a pixel, a scene that does not
                compile, or a shader that was asked for and cannot be had.
        """
        self._mj: Any = import_mujoco()
        self.rig = rig
        self.supersample = supersample
        self._animate = animate
        self._near_m, self._far_m = clip_m or (0.5 * depth_range_m[0], 4.0 * depth_range_m[1])
        self._lamp_at, self._carrier = lamp_at, carrier
        self._fine = border_px is not None
        self._lenses = tuple(lens.lens_of(rig, k, self._lens_samples) for k in range(len(rig)))
        drawn = lens.widened(rig, border_px or 0)
        drawn_lenses = self._lenses
        if self._fine:
            drawn_lenses = tuple(
                lens.lens_of(rig, k, supersample, border_px or 0) for k in range(len(rig))
            )
        self._views = tuple(
            FineView(*view, supersample)
            for view in zip(rig.cameras, drawn.cameras, drawn_lenses, strict=True)
        )
        self._buffer_px = lens.buffer_size(drawn, (*drawn_lenses, *self._lenses), supersample)
        self.model = _compiled(spec)
        self._gl = open_context(*self._buffer_px)
        self._open_parts = ExitStack()
        self._open_parts.callback(self._gl.free)
        try:
            self._open(*self._buffer_px, floats, shader)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

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

    def at(self, t_s: float) -> None:
        """Puts the bodies that move by themselves where they are at `t_s`, s from the start."""
        if self._animate is not None:
            self._animate(self.model, self._data, t_s)
            self._mj.mj_kinematics(self.model, self._data)
            self._update_scene()
            self._drawn.updated()

    @cached_property
    def geoms(self) -> dict[int, Geom]:
        """All geoms of the model by id."""
        return geom_table(self.model)

    def T_world_geoms(self, t_s: float) -> Pose:
        """(G, 4, 4) poses of all geoms at a time, whatever `at` was called with."""
        self._pose(self._posed, t_s)
        self._mj.mj_kinematics(self.model, self._posed)
        poses = np.tile(np.eye(4), (self.model.ngeom, 1, 1))
        poses[:, :3, :3] = self._posed.geom_xmat.reshape(-1, 3, 3)
        poses[:, :3, 3] = self._posed.geom_xpos
        return poses

    def enclosing(self, point_m: Pose) -> str | None:
        """The name of a geom with a point (3,) inside at the start; None without one."""
        data = self._mj.MjData(self.model)
        self._pose(data, 0.0)
        self._mj.mj_forward(self.model, data)
        return enclosing_geom(self.model, data, point_m, self._carrier)

    def identity(self, duration_s: float) -> list[NDArray[Any]]:
        """The compiled model, and where bodies are at some times."""
        model = np.zeros(self._mj.mj_sizeModel(self.model), np.uint8)
        self._mj.mj_saveModel(self.model, None, model)
        if self._animate is None:
            return [model]
        arrays = [model, np.array([self._animate.max_interval_us], float)]
        # Early as well: bodies that start at other speeds have not gone far, but may come to rest.
        times_s = (*_EARLY_S, *np.linspace(0, duration_s, _IDENTITY_SAMPLES))
        data = self._mj.MjData(self.model)
        for t_s in sorted(t for t in times_s if t <= duration_s):
            self._pose(data, float(t_s))
            arrays += [data.qpos.copy(), data.mocap_pos.copy(), data.mocap_quat.copy()]
        return arrays

    @cached_property
    def _posed(self) -> Any:
        return self._mj.MjData(self.model)

    def _pose(self, data: Any, t_s: float) -> None:
        if self._animate is not None:
            self._animate(self.model, data, t_s)

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

    def beyond_far(self, camera: int, T_world_body: Pose) -> NDArray[np.bool_]:
        """(H, W) where a surface is not seen because it lies beyond the farther clipping plane."""
        seen = np.isfinite(self.depth(camera, T_world_body))
        if seen.all():
            return ~seen
        far_m, self._far_m = self._far_m, _FAR * self._far_m
        try:
            return ~seen & np.isfinite(self.depth(camera, T_world_body))
        finally:
            self._far_m = far_m

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

    def _seen(self, camera: int, border: bool) -> tuple[LensMap | None, Camera]:
        """A camera and its lens, with or without a fine frame's border."""
        if border:
            return self._views[camera].lens, self._views[camera].drawn
        return self._lenses[camera], self.rig.cameras[camera]

    def _open(self, width_px: int, height_px: int, floats: bool, shader: bool | None) -> None:
        mj = self._mj
        self._data = mj.MjData(self.model)
        mj.mj_forward(self.model, self._data)
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
        self._scene = mj.MjvScene(self.model, 2 * self.model.ngeom + 1000)
        for name in ("SHADOW", "REFLECTION", "HAZE", "FOG"):
            self._scene.flags[getattr(mj.mjtRndFlag, f"mjRND_{name}")] = 0
        # One mirror pass costs a whole picture: only for scenes that have something to mirror.
        self._scene.flags[mj.mjtRndFlag.mjRND_REFLECTION] = mirrors
        self._option = mj.MjvOption()
        self._option.sitegroup[:] = 0
        # Aids of a viewer are no surfaces: rays of range finders, tendons. What bends, skins and
        # flexes, has no pose of which truth could be made; `sim.model.survey` says so.
        self._option.flags[:] = 0
        for flag in (mj.mjtVisFlag.mjVIS_TEXTURE, mj.mjtVisFlag.mjVIS_STATIC):
            self._option.flags[int(flag)] = 1
        self._update_scene()
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

    def _update_scene(self) -> None:
        mj = self._mj
        viewer, everything = mj.MjvCamera(), mj.mjtCatBit.mjCAT_ALL
        mj.mjv_updateScene(
            self.model, self._data, self._option, None, viewer, everything, self._scene
        )
        lights = self._scene.lights[: self._scene.nlight]
        self._head_lamps = [light for light in lights if light.headlight]

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

    @property
    def _lens_samples(self) -> int:
        most = _MOST_LENS_SAMPLES if self._fine else self.supersample
        return max(min(self.supersample, most), _LEAST_LENS_SAMPLES)

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
        T_world_lamp = T_world_body if self._lamp_at is None else self._lamp_at
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

    def _clip_m(self, mapped: LensMap | None) -> tuple[float, float]:
        """The clipping planes of a picture; of sub-views, so far that no depth of theirs is cut."""
        if mapped is None:
            return self._near_m, self._far_m
        least, most = mapped.ratio_range
        return self._near_m / most, self._far_m / least

    def _metric_depth(
        self, window_depth: NDArray[np.float32], mapped: LensMap | None
    ) -> NDArray[np.float32]:
        """Z-depth (H, W) in the camera's axes, m, from window depth at pixels' centres."""
        depth_m = metric_depth(window_depth, *self._clip_m(mapped))
        return depth_m if mapped is None else depth_m * mapped.ratio[..., 0]


def _compiled(spec: Any) -> Any:
    """A model for a renderer alone, compiled from a copy of a spec, or a copy of a model."""
    parsed = hasattr(spec, "compile")
    own = spec.copy() if parsed else copy.deepcopy(spec)
    visual = own.visual if parsed else own.vis
    # MuJoCo's own buffer, which is not drawn into.
    visual.global_.offwidth = visual.global_.offheight = 1
    visual.quality.offsamples = 0
    visual.quality.shadowsize = 0  # none is drawn: no map for them, of 64 MB
    return compiled(own) if parsed else own


def metric_depth(
    window_depth: NDArray[np.float32], near_m: float, far_m: float
) -> NDArray[np.float32]:
    """Turns window depth (1 at the near plane, 0 at the far plane) into z-depth, m; inf at 0."""
    reciprocal = (window_depth.astype(np.float64) * (far_m - near_m) + near_m) / (near_m * far_m)
    return np.where(window_depth > 0, 1 / reciprocal, np.inf).astype(np.float32)
