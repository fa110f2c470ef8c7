"""Pictures of a scene through any camera of a rig: linear intensity and metric depth."""

from __future__ import annotations

from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from emvs.data.camera import Camera
from emvs.data.rig import Rig
from emvs.errors import InputError
from sim import pixels
from sim.graphics import import_mujoco, open_context

if TYPE_CHECKING:
    import mujoco

Pose = NDArray[np.float64]


class Frame(NamedTuple):
    """One supersampled picture.

    Attributes:
        intensity: (H, W) float32, linear, 0 to 1.
        nearest_depth_m: (H, W) float32, the least z-depth of each pixel's samples; inf where no
            sample meets a surface.
    """

    intensity: NDArray[np.float32]
    nearest_depth_m: NDArray[np.float32]


class StereoRenderer:
    """Renders a static scene with MuJoCo's classic renderer, shadows and reflections off.

    The cameras are not part of the MuJoCo model: each picture sets the OpenGL frustum from the
    calibrated intrinsics, which is exact for any principal point and for unequal focal lengths.
    What the renderer calls colour is taken as linear radiance, so lighting and textures mean what
    their numbers say. MuJoCo's headlight is a lamp on the body, the same for all cameras.
    A renderer belongs to the thread that made it.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        rig: Rig,
        supersample: int = 1,
        depth_range_m: tuple[float, float] = (0.1, 50.0),
    ) -> None:
        """Compiles the scene and opens a graphics context.

        Args:
            spec: the scene; compiled from a copy, not changed.
            rig: pinhole cameras and their places on the body.
            supersample: samples per pixel and axis.
            depth_range_m: what the clipping planes must enclose; they lie at half the near and
                four times the far end.

        Raises:
            InputError: no graphics, a camera with distortion, or a scene that does not compile.
        """
        _check_pinhole(rig)
        self._mj: Any = import_mujoco()
        self.rig = rig
        self.supersample = supersample
        self._near_m, self._far_m = 0.5 * depth_range_m[0], 4.0 * depth_range_m[1]
        width_px = supersample * max(camera.width_px for camera in rig.cameras)
        height_px = supersample * max(camera.height_px for camera in rig.cameras)
        self.model = _compiled(spec, width_px, height_px)
        self._open(width_px, height_px)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Frees the graphics context."""
        self._context.free()
        self._gl.free()

    @property
    def description(self) -> str:
        """What renders: MuJoCo's version and the back end, for a sequence's manifest."""
        back_end = type(self._gl).__module__.rsplit(".", 1)[-1]
        return f"mujoco {self._mj.__version__} classic, {back_end}"

    def frame(self, camera: int, T_world_body: Pose) -> Frame:
        """Renders what `camera` sees from `T_world_body` (4, 4), averaged over the samples."""
        rgb, window_depth = self._draw(camera, T_world_body, self.supersample)
        seen = self.rig.cameras[camera]
        intensity = np.empty((seen.height_px, seen.width_px), np.float32)
        nearest = np.empty_like(intensity)
        pixels.average(rgb, window_depth, self.supersample, intensity, nearest)
        return Frame(intensity, pixels.metric_depth(nearest, self._near_m, self._far_m))

    def depth(self, camera: int, T_world_body: Pose) -> NDArray[np.float32]:
        """Returns the z-depth (H, W) at every pixel's centre, m; inf where there is no surface."""
        _, window_depth = self._draw(camera, T_world_body, 1)
        return pixels.metric_depth(window_depth[::-1], self._near_m, self._far_m)

    def segmentation(self, camera: int, T_world_body: Pose) -> NDArray[np.int32]:
        """Returns the geom id (H, W) at every pixel's centre; -1 where there is none."""
        flags = self._scene.flags
        flags[self._mj.mjtRndFlag.mjRND_SEGMENT] = 1
        flags[self._mj.mjtRndFlag.mjRND_IDCOLOR] = 1
        try:
            rgb, _ = self._draw(camera, T_world_body, 1)
        finally:
            flags[self._mj.mjtRndFlag.mjRND_SEGMENT] = 0
            flags[self._mj.mjtRndFlag.mjRND_IDCOLOR] = 0
        segment = rgb[::-1].astype(np.int32) @ np.array([1, 1 << 8, 1 << 16], np.int32)
        geom_id = np.full(self._scene.ngeom + 1, -1, np.int32)
        geom_id[1:] = [geom.objid for geom in self._scene.geoms[: self._scene.ngeom]]
        return geom_id[segment]

    def _open(self, width_px: int, height_px: int) -> None:
        mj = self._mj
        self._data = mj.MjData(self.model)
        mj.mj_forward(self.model, self._data)
        self._gl = open_context(width_px, height_px)
        self._context = mj.MjrContext(self.model, mj.mjtFontScale.mjFONTSCALE_100)
        self._context.readDepthMap = mj.mjtDepthMap.mjDEPTH_ZEROFAR
        mj.mjr_setBuffer(mj.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mj.MjvScene(self.model, 2 * self.model.ngeom + 1000)
        for name in ("SHADOW", "REFLECTION", "HAZE", "FOG"):
            self._scene.flags[getattr(mj.mjtRndFlag, f"mjRND_{name}")] = 0
        option = mj.MjvOption()
        option.sitegroup[:] = 0
        # Nothing moves but the cameras, so once is enough.
        viewer, everything = mj.MjvCamera(), mj.mjtCatBit.mjCAT_ALL
        mj.mjv_updateScene(self.model, self._data, option, None, viewer, everything, self._scene)
        lights = self._scene.lights[: self._scene.nlight]
        self._head_lamps = [light for light in lights if light.headlight]

    def _draw(
        self, camera: int, T_world_body: Pose, supersample: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Colour and window depth (1 near, 0 far) at the samples, bottom row first."""
        seen = self.rig.cameras[camera]
        T_world_cam = T_world_body @ self.rig.T_body_cam[camera]
        self._gl.make_current()
        self._place(seen, T_world_cam)
        for lamp in self._head_lamps:
            lamp.pos, lamp.dir = T_world_body[:3, 3], T_world_body[:3, 2]
        width_px, height_px = seen.width_px * supersample, seen.height_px * supersample
        rect = self._mj.MjrRect(0, 0, width_px, height_px)
        rgb = np.empty((height_px, width_px, 3), np.uint8)
        window_depth = np.empty((height_px, width_px), np.float32)
        self._mj.mjr_render(rect, self._scene, self._context)
        self._mj.mjr_readPixels(rgb, window_depth, rect, self._context)
        return rgb, window_depth

    def _place(self, camera: Camera, T_world_cam: Pose) -> None:
        """Sets pose and frustum of both eyes; the one place where z forward becomes -z."""
        left, right, top, bottom = self._near_m * _edges(camera)
        for eye in self._scene.camera:
            eye.pos, eye.forward, eye.up = (
                T_world_cam[:3, 3],
                T_world_cam[:3, 2],
                -T_world_cam[:3, 1],
            )
            eye.frustum_center, eye.frustum_width = (left + right) / 2, (right - left) / 2
            eye.frustum_top, eye.frustum_bottom = -top, -bottom
            eye.frustum_near, eye.frustum_far = self._near_m, self._far_m


def _edges(camera: Camera) -> NDArray[np.float64]:
    """Bearings x/z of the left and right and y/z of the top and bottom edge of the sensor."""
    # Pixel centres are integers, so the sensor ends half a pixel beyond the outermost centres.
    return np.array(
        [
            (-0.5 - camera.cx_px) / camera.fx_px,
            (camera.width_px - 0.5 - camera.cx_px) / camera.fx_px,
            (-0.5 - camera.cy_px) / camera.fy_px,
            (camera.height_px - 0.5 - camera.cy_px) / camera.fy_px,
        ]
    )


def _check_pinhole(rig: Rig) -> None:
    for name, camera in zip(rig.camera_names, rig.cameras, strict=True):
        if camera.model != "pinhole":
            raise InputError(
                f"camera {name} of rig {rig.name} has {camera.model} distortion, but the renderer "
                "draws pinhole cameras only: use its `.undistorted()`"
            )


def _compiled(spec: mujoco.MjSpec, width_px: int, height_px: int) -> Any:
    own = spec.copy()
    own.visual.global_.offwidth, own.visual.global_.offheight = width_px, height_px
    own.visual.quality.offsamples = 0
    try:
        return own.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"the scene does not compile ({reason}): correct its MJCF") from error
