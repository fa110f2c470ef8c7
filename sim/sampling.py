"""How finely a scene is drawn, for a rig: samples per pixel, and pixels beyond the sensor's edge.

What a picture's samples get wrong is an angle: an edge may lie anywhere between two of them. Events
of a turning head are late or early by that angle, so samples are counted per angle, not per pixel.
"""

from __future__ import annotations

import math

from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import SAMPLINGS, Sampling, SimConfig

_MOST = 8
# What is drawn in floats is dark or of high contrast: the same error is more of its logarithm.
_IN_FLOATS = 4 / 3
# What carried light may touch beyond the furthest motion.
_BESIDE_PX = 2


def border_px(config: SimConfig) -> int | None:
    """Pixels that fine frames reach beyond the sensor; None where frames are plain."""
    return None if config.sampling == "linear" else math.ceil(config.spacing_px) + _BESIDE_PX


def with_sampling(
    config: SimConfig, rig: Rig, why_plain: str = "", *, floats: bool = False, finer: float = 1.0
) -> SimConfig:
    """The parameters with `supersample`, `max_displacement_px` and the longest interval filled in.

    The rig's smallest focal length decides. With a reason of `Drawing.why_plain` frames are plain
    and close together, with as many samples as fine ones would have. `floats` says how light is
    drawn, `finer` how many times as many samples the renderer's default is (`base.finer`).
    """
    chosen = SAMPLINGS[config.sampling]
    if why_plain:
        plain = config.model_copy(update={"sampling": "linear"})
        near = {"max_displacement_px": min(plain.spacing_px, SAMPLINGS["linear"].spacing_px)}
        config = plain.model_copy(update=near)
    number = config.supersample
    if number is None:
        number = _samples(chosen, rig, finer * (_IN_FLOATS if floats else 1.0))
    filled = {
        "supersample": number,
        "max_displacement_px": config.spacing_px,
        "max_frame_interval_us": config.longest_interval_us,
    }
    return config.model_copy(update=filled)


def _samples(chosen: Sampling, rig: Rig, times: float) -> int:
    """Samples per pixel and axis, an even number unless it is the fewest.

    Rows of an even number lie beside one another (`fine_light.FineView.stride`): thin upright
    things are met by twice as many columns.
    """
    focal_px = min(min(camera.fx_px, camera.fy_px) for camera in rig.cameras)
    even = 2 * math.ceil(times * chosen.samples_per_rad / focal_px / 2)
    return min(max(even, chosen.fewest), _MOST)
