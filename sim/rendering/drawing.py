"""MuJoCo as the simulator's renderer, opened for a scene's file or for a model in memory.

A plug-in offers another renderer of such scenes under the name that `light.renderer` chooses it by:

    [project.entry-points."eventsweep.renderers"]
    mine = "my_package.drawing:MyDrawing"

It is called with a compiled model, or None for the scene's file, and gives a `ModelDrawing`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, cast

from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.plugins import RENDERERS, offered, points
from eventsweep.sim.config import AUTO, CLASSIC, FLOAT, SimConfig
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


class ModelDrawing(Drawing, Protocol):
    """What a plug-in draws with."""

    def lacks(self, scene: Scene) -> str:
        """What it cannot draw of a scene, in a few words; empty where it draws all of it."""


def drawing_of(
    scene: Scene, config: SimConfig, notice: Callable[[str], None], model: Any = None
) -> Drawing:
    """What draws a scene, or a model in its place, as `config.light.renderer` says.

    MuJoCo takes the place of a plug-in that cannot draw the scene, and `notice` is called with one
    line that says why.

    Raises:
        InputError: no plug-in offers this renderer, or it cannot be loaded.
    """
    name, mujoco = config.light.renderer, MujocoDrawing(model) if model is not None else MUJOCO
    own = AUTO, CLASSIC, FLOAT
    if name in own:
        return mujoco
    known = (*own, *(point.name for point in points(RENDERERS)))
    drawing = cast("ModelDrawing", offered(RENDERERS, name, "renderer", known)(model))
    lacking = drawing.lacks(scene)
    if not lacking:
        return drawing
    notice(f"{scene.name}: drawn by MuJoCo, because renderer {name} lacks {lacking}")
    return mujoco
