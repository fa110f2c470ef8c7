"""The plug-in's door: opens renderers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.raster.renderer import RasterRenderer
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.rendering.drawing import MujocoDrawing
from eventsweep.sim.scene import Scene


@dataclass(frozen=True, eq=False)
class RasterDrawing:
    """Draws with compiled loops what MuJoCo models; see `sim.rendering.drawing`."""

    model: Any = None
    finer: ClassVar[float] = 4 / 3

    def why_plain(self, scene: Scene) -> str:
        """Why light cannot be carried along the scene's surfaces; empty where it can."""
        return MujocoDrawing(self.model).why_plain(scene)

    def open(
        self, scene: Scene, rig: Rig, supersample: int, *, floats: bool, border_px: int | None
    ) -> RasterRenderer:
        """Compiles the scene; no graphics library is loaded."""
        import_mujoco(draws=False)
        return RasterRenderer(
            scene.spec() if self.model is None else self.model, rig, supersample,
            scene.depth_range_m, floats=floats, animate=scene.animate, border_px=border_px,
            clip_m=scene.clip_m, lamp_at=scene.lamp_at, carrier=scene.carrier,
        )  # fmt: skip
