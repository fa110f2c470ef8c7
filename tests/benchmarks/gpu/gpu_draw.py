"""Draws one rig's view of a scene for a while and counts pictures: a program of its own.

Usage: `python tests/benchmarks gpu_draw KIND RIG SECONDS`; KIND is classic, float, filament, or for
fine frames kernels or shader: what makes light of their samples.
The last line on standard output is JSON. Filament ends its process where it fails, and drivers may.
"""

from __future__ import annotations

import collections.abc
import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from eventsweep import scenes
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering import lens
from eventsweep.sim.rendering.base import Frame
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig as named_rig
from eventsweep.sim.sampling import border_px, with_sampling

SCENE = "desk"
_BATCH = 4
_COMPARED = 5


def rate(draw: Callable[[float], object], duration_s: float, seconds: float) -> float:
    """Pictures per second along the scene's motion, after a few that only warm up."""
    for _ in range(_BATCH):
        draw(0.0)
    begin, count = time.perf_counter(), 0
    while time.perf_counter() - begin < seconds or count < _BATCH:
        for _ in range(_BATCH):
            draw(0.01 * count % duration_s)
            count += 1
    return count / (time.perf_counter() - begin)


def classic(rig_name: str, seconds: float, *, floats: bool) -> dict[str, Any]:
    """Pictures of camera 0 as the simulator draws them: intensity and depth, in memory."""
    scene, rig = scenes.load(SCENE), named_rig(rig_name)
    motion = scene.motion(scene.duration_s, 0)
    with StereoRenderer(scene.spec(), rig, 1, scene.depth_range_m, floats=floats) as renderer:
        found = rate(
            lambda t_s: renderer.frame(0, motion.T_world_body(t_s)), scene.duration_s, seconds
        )
        return {"per_s": found, "drawn_by": renderer.description}


def fine(rig_name: str, seconds: float, *, shader: bool) -> dict[str, Any]:
    """Fine frames of camera 0, sampled as `accurate` does; from a shader, held against the kernels.

    `apart` is the greatest difference of light, of full scale, and of the depth, of itself.
    """
    scene, rig = scenes.load(SCENE), named_rig(rig_name)
    motion, config = scene.motion(scene.duration_s, 0), with_sampling(SimConfig(), rig)
    assert config.supersample is not None
    arguments = scene.spec(), rig, config.supersample, scene.depth_range_m
    border = border_px(config)
    with StereoRenderer(*arguments, border_px=border, shader=shader) as renderer:
        poses = [motion.T_world_body(0.1 * k % scene.duration_s) for k in range(_COMPARED)]
        frames = [renderer.frame(0, pose) for pose in poses]
        found = rate(
            lambda t_s: renderer.frame(0, motion.T_world_body(t_s)), scene.duration_s, seconds
        )
        drawn_by = renderer.description
    if not shader:
        return {"per_s": found, "drawn_by": drawn_by}
    with StereoRenderer(*arguments, border_px=border, shader=False) as renderer:
        apart = [
            _apart(frame, renderer.frame(0, p)) for frame, p in zip(frames, poses, strict=True)
        ]
    return {"per_s": found, "drawn_by": drawn_by, "apart": np.max(apart, axis=0).tolist()}


def _apart(found: Frame, expected: Frame) -> tuple[float, float]:
    assert found.samples is not None
    assert expected.samples is not None
    rho, true_rho = 1 / found.nearest_depth_m, 1 / expected.nearest_depth_m
    return (
        float(np.abs(found.samples.light - expected.samples.light).max()),
        float((np.abs(rho - true_rho) / np.maximum(true_rho, 1e-9)).max()),
    )


def filament(rig_name: str, seconds: float) -> dict[str, Any]:
    """Pictures of camera 0 by MuJoCo's Filament renderer: linear light, one float per pixel."""
    _buffer_type()
    mujoco: Any = importlib.import_module("mujoco")
    importlib.import_module("mujoco.studio.window")  # registers what the renderer needs
    mjrf: Any = importlib.import_module("mujoco.mjrf")
    scene, rig = scenes.load(SCENE), named_rig(rig_name)
    motion, camera = scene.motion(scene.duration_s, 0), rig.cameras[0]
    config = mjrf.ContextConfig()
    config.graphics_api = mjrf.GraphicsApi.GRAPHICS_API_VULKAN
    context = mjrf.Context(config)
    model = scene.spec().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    drawing = _Filament(mjrf, context, model, data, camera)
    T_body_cam, near_m = rig.T_body_cam[0], 0.5 * scene.depth_range_m[0]
    found = rate(
        lambda t_s: drawing.draw(motion.T_world_body(t_s) @ T_body_cam, near_m),
        scene.duration_s, seconds,
    )  # fmt: skip
    if not np.ptp(drawing.light) > 0:
        raise RuntimeError("the picture is empty")
    return {"per_s": found, "drawn_by": f"mujoco {mujoco.__version__} filament, Vulkan"}


class _Filament:
    """A scene in Filament, and the picture that it is drawn into."""

    def __init__(self, mjrf: Any, context: Any, model: Any, data: Any, camera: Camera) -> None:
        folder = "mujoco.rendering.filament"
        self._renderer: Any = importlib.import_module(f"{folder}.renderer")
        made = importlib.import_module(f"{folder}.model_scene").ModelScene(context, model)
        made.update(data)
        self._mjrf, self._camera, self._kept = mjrf, camera, (made, model, data, context)
        self._drawing = self._renderer.Renderer(context)
        self._drawing._scenes["scene"] = made.scene
        self.light = np.zeros((camera.height_px, camera.width_px), np.float32)
        self._drawing.target("light", self.light, mjrf.PixelFormat.PIXEL_FORMAT_R32F)

    def draw(self, T_world_cam: Any, near_m: float) -> None:
        """Draws into `light`."""
        left, right, top, bottom = near_m * lens.edges(self._camera)
        eye = self._mjrf.Camera(
            pos=T_world_cam[:3, 3], forward=T_world_cam[:3, 2], up=-T_world_cam[:3, 1],
            frustum_bottom=-bottom, frustum_top=-top, frustum_near=near_m, frustum_far=100 * near_m,
        )  # fmt: skip
        eye.frustum_center, eye.frustum_width = (left + right) / 2, (right - left) / 2
        plain = {"post_processing": False, "reflections": False, "shadows": False}
        view = self._renderer.View("scene", "light", camera=eye, skybox=False, haze=False, **plain)
        self._drawing.render([view])


def _buffer_type() -> None:
    """What MuJoCo's module wants of Python 3.12, on 3.11."""
    if not hasattr(collections.abc, "Buffer"):
        its: Any = importlib.import_module("typing_extensions")
        setattr(collections.abc, "Buffer", its.Buffer)  # noqa: B010


def main(kind: str, rig_name: str, seconds: str) -> None:
    """Draws, prints, and ends without tearing anything down: that can crash."""
    if kind == "filament":
        found = filament(rig_name, float(seconds))
    elif kind in ("kernels", "shader"):
        found = fine(rig_name, float(seconds), shader=kind == "shader")
    else:
        found = classic(rig_name, float(seconds), floats=kind == "float")
    sys.stdout.write("\n" + json.dumps(found) + "\n")
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
