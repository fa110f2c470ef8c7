"""Textured panels that face the camera at known depths: for exact laws."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import default_rng

from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.motion.curves import HeadSway, Wave, look_at
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    from eventsweep.scenes.textures.noise import Image

PLANE_DEPTHS_M = (0.8, 1.1, 1.6, 2.4, 4.0)
"""Z-depth of the geoms panel_0 to panel_4 in every camera, at every time."""

# About one texel for each pixel of a 1280x720 camera of f = 1050 px.
_TEXTURE_SHAPES = ((640, 768), (640, 1088), (704, 896), (704, 1024), (1536, 2048))
_TINTS = (
    (1.0, 0.86, 0.72),
    (0.78, 0.92, 1.0),
    (0.84, 1.0, 0.8),
    (1.0, 0.9, 0.95),
    (0.95, 0.95, 0.9),
)


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx

    pictures: dict[str, Image] = {}
    rngs = tx.streams(21, len(_TINTS))
    for k, (shape, tint, rng) in enumerate(zip(_TEXTURE_SHAPES, _TINTS, rngs, strict=True)):
        noise = tx.fractal(shape, rng, 0.9)[..., None]
        mixed = 0.7 * tx.dead_leaves(shape, rng, 26) + 0.8 * (noise - 0.5) + 0.15
        pictures[f"panel_{k}"] = tx.finish(mixed * np.asarray(tint, np.float32))
    return pictures


def _motion(_duration_s: float, seed: int) -> HeadSway:
    """Slides sideways and a little up and down, parallel to the panels; never turns."""
    rng = default_rng(seed)
    ahead = look_at((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    side = float(rng.choice((-1.0, 1.0)))
    start = -np.pi / 2 + rng.uniform(0.1, 0.3)
    # Long against the baseline, so that the far panels are measured as exactly as the near ones.
    slide = Wave(
        1.3,
        amplitude_m=(side * float(rng.uniform(0.26, 0.28)), float(rng.uniform(0.02, 0.04)), 0.0),
        phase_rad=(float(start), float(rng.uniform(0, 2 * np.pi)), 0.0, 0.0, 0.0, 0.0),
    )
    return HeadSway(ahead, (slide,))


SCENE = Scene(
    name="planes",
    summary="five textured panels that face the camera at known depths, 0.8 to 4 m",
    mjcf=Path(__file__).with_suffix(".xml"),
    textures=_textures,
    motion=_motion,
    depth_range_m=(0.7, 4.5),
)
