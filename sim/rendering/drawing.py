"""MuJoCo as the simulator's renderer, opened for a scene's file or for a model in memory.

A plug-in offers another renderer of such scenes under the name that `light.renderer` chooses it by:

    [project.entry-points."eventsweep.renderers"]
    mine = "my_package.drawing:MyDrawing"

It is called with a compiled model, or None for the scene's file, and gives a `Drawing`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, cast

from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.plugins import RENDERERS, is_ours, offered, points
from eventsweep.sim.config import AUTO, EITHER, OF_MUJOCO, SimConfig
from eventsweep.sim.graphics import gpu_draws, import_mujoco
from eventsweep.sim.rendering.base import Drawing
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.scene import Scene

MIRRORS = "a surface mirrors"


@dataclass(frozen=True, eq=False)
class MujocoDrawing:
    """Draws with MuJoCo; a compiled model may take the place of the scene's file."""

    model: Any = None

    def why_plain(self, scene: Scene) -> str:
        """Why light cannot be carried along the scene's surfaces; empty where it can.

        What a mirror shows moves otherwise than the mirror, and a lamp on the head moves with it.
        """
        if self.model is None:
            spec = scene.spec()
            mirrors, lamp = any(m.reflectance > 0 for m in spec.materials), spec.visual.headlight
        else:
            mirrors, lamp = bool((self.model.mat_reflectance > 0).any()), self.model.vis.headlight
        if mirrors:
            return MIRRORS
        lit = scene.lamp_at is None and lamp.active and (any(lamp.diffuse) or any(lamp.specular))
        return "there is a lamp on the head" if lit else ""

    def open(
        self, scene: Scene, rig: Rig, supersample: int, *, floats: bool, border_px: int | None
    ) -> StereoRenderer:
        """Opens a graphics context of the calling process and thread."""
        return StereoRenderer(
            scene.spec() if self.model is None else self.model, rig, supersample,
            scene.depth_range_m, floats=floats, animate=scene.animate, border_px=border_px,
            clip_m=scene.clip_m, lamp_at=scene.lamp_at, carrier=scene.carrier,
        )  # fmt: skip


MUJOCO = MujocoDrawing()


@cache
def default_renderer() -> str:
    """What `auto` stands for here: MuJoCo on a GPU, else our plug-in, else MuJoCo in software."""
    ours = [point.name for point in points(RENDERERS) if is_ours(point)]
    return EITHER if not ours or gpu_draws() else ours[0]


def decided(config: SimConfig, begun: str | None = None) -> SimConfig:
    """The parameters with a renderer's name for `auto`: the one that a work has `begun` with."""
    if config.light.renderer != AUTO:
        return config
    name = begun or default_renderer()
    return config.model_copy(update={"light": config.light.model_copy(update={"renderer": name})})


def drawing_of(config: SimConfig, model: Any = None) -> Drawing:
    """What draws a scene, or a compiled model in its place, as `config.light.renderer` says.

    No graphics library is loaded for the renderer of a plug-in.

    Raises:
        InputError: no plug-in offers this renderer, or it cannot be loaded.
    """
    name = decided(config).light.renderer
    if name in OF_MUJOCO:
        return MUJOCO if model is None else MujocoDrawing(model)
    known = (AUTO, *OF_MUJOCO, *(point.name for point in points(RENDERERS)))
    opens = offered(RENDERERS, name, "renderer", known)
    import_mujoco(draws=False)
    return cast("Drawing", opens(model))
