"""What renderers of MuJoCo's models share: the model, where its bodies are, what cameras need."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.tables import Geom
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.geoms import enclosing_geom, geom_table
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.mjcf import compiled
from eventsweep.sim.motion import Animation
from eventsweep.sim.rendering import lens
from eventsweep.sim.rendering.base import Pose
from eventsweep.sim.rendering.fine_light import FineView
from eventsweep.sim.rendering.sub_views import LensMap

if TYPE_CHECKING:
    import mujoco

# Samples per pixel and axis where depth and geoms are looked up through a distorting lens: at
# least, and with fine frames at most. Only edges gain by more: they lie wrong by half a sample.
_LEAST_LENS_SAMPLES, _MOST_LENS_SAMPLES = 2, 3
# How much farther a look goes that asks what the farther clipping plane hides.
_FAR = 1000
# When moving bodies are looked at to tell one animation from another: evenly, and early.
_IDENTITY_SAMPLES, _EARLY_S = 32, (0.001, 0.01, 0.1)


class ModelRenderer(ABC):
    """A compiled model, its `MjvScene` and the views of a rig; what draws is left to others.

    The cameras are not part of the model. A camera with distortion is resampled from pinhole
    pictures of its parts, see `sim.rendering.sub_views`. MuJoCo's headlight is a lamp on the body,
    the same for all cameras. A renderer belongs to the thread that made it.
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
        clip_m: tuple[float, float] | None = None,
        lamp_at: Pose | None = None,
        carrier: str = "",
    ) -> None:
        """Compiles the scene.

        Args:
            spec: the scene, to be compiled or compiled; a copy of it is used.
            rig: cameras and their places on the body.
            supersample: samples per pixel and axis.
            depth_range_m: the clipping planes lie at half its near and four times its far end.
            floats: draw light in floating point, without steps and without end.
            animate: moves the bodies that move by themselves; see `at`.
            border_px: makes fine frames: with the light between the pixels, textures sharp, and so
                many pixels beyond the sensor's edge, as far as its lens has rays there.
            clip_m: where the clipping planes lie instead.
            lamp_at: (4, 4) where the headlight stays; by default it goes with the body.
            carrier: the body that carries the rig: cameras may lie inside its geoms.

        Raises:
            InputError: a lens without a ray for a pixel, or a scene that does not compile.
        """
        self._mj: Any = import_mujoco()
        self.rig, self.supersample, self._floats = rig, supersample, floats
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
        self._data = self._mj.MjData(self.model)
        self._mj.mj_forward(self.model, self._data)
        self._scene = self._mj.MjvScene(self.model, 2 * self.model.ngeom + 1000)
        self._option = self._mj.MjvOption()
        self._option.sitegroup[:] = 0
        # Aids of a viewer are no surfaces: rays of range finders, tendons. What bends, skins and
        # flexes, has no pose of which truth could be made; `sim.model.survey` says so.
        self._option.flags[:] = 0
        for flag in (self._mj.mjtVisFlag.mjVIS_TEXTURE, self._mj.mjtVisFlag.mjVIS_STATIC):
            self._option.flags[int(flag)] = 1
        self._update_scene()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Frees what drawing needs."""

    def at(self, t_s: float) -> None:
        """Puts the bodies that move by themselves where they are at `t_s`, s from the start."""
        if self._animate is not None:
            self._animate(self.model, self._data, t_s)
            self._mj.mj_kinematics(self.model, self._data)
            self._moved()

    def _moved(self) -> None:
        """Bodies are elsewhere: what is drawn must follow."""
        self._update_scene()

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

    def _update_scene(self) -> None:
        mj = self._mj
        viewer, everything = mj.MjvCamera(), mj.mjtCatBit.mjCAT_ALL
        mj.mjv_updateScene(
            self.model, self._data, self._option, None, viewer, everything, self._scene
        )
        lights = self._scene.lights[: self._scene.nlight]
        self._head_lamps = [light for light in lights if light.headlight]

    def _T_world_lamp(self, T_world_body: Pose) -> Pose:
        """(4, 4) where the headlight is."""
        return T_world_body if self._lamp_at is None else self._lamp_at

    def _seen(self, camera: int, border: bool) -> tuple[LensMap | None, Camera]:
        """A camera and its lens, with or without a fine frame's border."""
        if border:
            return self._views[camera].lens, self._views[camera].drawn
        return self._lenses[camera], self.rig.cameras[camera]

    @abstractmethod
    def depth(
        self, camera: int, T_world_body: Pose, view: Camera | None = None, *, border: bool = False
    ) -> NDArray[np.float32]:
        """See `sim.rendering.base.Renderer`."""

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

    @property
    def _lens_samples(self) -> int:
        most = _MOST_LENS_SAMPLES if self._fine else self.supersample
        return max(min(self.supersample, most), _LEAST_LENS_SAMPLES)

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
