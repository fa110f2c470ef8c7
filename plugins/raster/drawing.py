"""The plug-in's door: opens renderers, and says what they lack."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.raster.renderer import RasterRenderer
from eventsweep.plugins.raster.surfaces import DISTANCES, FIELD, MESH, SOLID
from eventsweep.sim.rendering.drawing import MujocoDrawing
from eventsweep.sim.scene import Scene


@dataclass(frozen=True, eq=False)
class RasterDrawing:
    """Draws with compiled loops what MuJoCo models; see `sim.rendering.drawing`."""

    model: Any = None

    def lacks(self, scene: Scene) -> str:
        """What cannot be drawn of a scene, in a few words; empty where all can."""
        model = scene.spec().compile() if self.model is None else self.model
        return lacking(model)

    def why_plain(self, scene: Scene) -> str:
        """Why light cannot be carried along the scene's surfaces; empty where it can."""
        return MujocoDrawing(self.model).why_plain(scene)

    def open(
        self, scene: Scene, rig: Rig, supersample: int, *, floats: bool, border_px: int | None
    ) -> RasterRenderer:
        """Compiles the scene."""
        return RasterRenderer(
            scene.spec() if self.model is None else self.model, rig, supersample,
            scene.depth_range_m, floats=floats, animate=scene.animate, border_px=border_px,
            clip_m=scene.clip_m, lamp_at=scene.lamp_at, carrier=scene.carrier,
        )  # fmt: skip


def lacking(model: Any) -> str:
    """What cannot be drawn of a compiled model, in a few words; empty where all can."""
    folded = np.isin(model.geom_type, [FIELD, MESH, DISTANCES])
    glass = _opacity(model) < SOLID
    found = {
        "glass of meshes or height fields": bool(glass[folded].any()),
        "glass in mirrors": bool(glass.any() and (model.mat_reflectance > 0).any()),
        "textures with opacity": bool((model.tex_nchannel != 3).any()),
    }
    return ", ".join(name for name, there in found.items() if there)


def _opacity(model: Any) -> NDArray[np.float64]:
    """(G,) of geoms: their material's, or their own."""
    own, material = model.geom_rgba[:, 3].astype(float), model.geom_matid
    if not model.nmat:
        return np.asarray(own)
    return np.asarray(np.where(material >= 0, model.mat_rgba[material, 3], own))
