"""The plug-in's door: opens renderers, and says what they lack."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.raster.renderer import RasterRenderer
from eventsweep.sim.rendering.drawing import MujocoDrawing
from eventsweep.sim.scene import Scene


@dataclass(frozen=True, eq=False)
class RasterDrawing(MujocoDrawing):
    """Draws with compiled loops what MuJoCo models; see `sim.rendering.drawing`."""

    def lacks(self, scene: Scene) -> str:
        """What cannot be drawn of a scene, in a few words; empty where all can."""
        model = scene.spec().compile() if self.model is None else self.model
        return _lacking(model)

    def open(
        self, scene: Scene, rig: Rig, supersample: int, *, floats: bool, border_px: int | None
    ) -> RasterRenderer:
        """Compiles the scene."""
        return RasterRenderer(
            scene.spec() if self.model is None else self.model, rig, supersample,
            scene.depth_range_m, floats=floats, animate=scene.animate, border_px=border_px,
            clip_m=scene.clip_m, lamp_at=scene.lamp_at, carrier=scene.carrier,
        )  # fmt: skip


def _lacking(model: Any) -> str:
    found = {
        "mirrors": bool((model.mat_reflectance > 0).any()),
        "glass": bool((model.geom_rgba[:, 3] < 1).any() or (model.mat_rgba[:, 3] < 1).any()),
        "textures with opacity": bool((model.tex_nchannel != 3).any()),
        "more lights than 8": model.nlight > 7,
    }
    return ", ".join(name for name, there in found.items() if there)
