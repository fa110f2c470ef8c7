"""Whether 8 bits hold the light of a view: where it is dark their steps are events of their own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eventsweep.sim.config import PixelConfig
from eventsweep.sim.motion import Motion
from eventsweep.sim.rendering.base import Frame, Renderer

FEW = 0.05
"""Share of pixels that may be darker or brighter than 8 bits can tell."""
IN_FLOATS = (
    "{name}: {percent:.0f} % of the view is too dark or too bright for 8 bits, so light is "
    "rendered in floating point"
)
"""What is said then."""
# A step of 8 bits, in log intensity, as a share of the contrast threshold.
_COARSE = 0.25
# White is 1 but for rounding.
_ROUNDED = 1e-4


def share_beyond_8_bits(frame: Frame, config: PixelConfig, *, cut: bool = False) -> float:
    """Share of pixels with a surface whose contrast 8 bits cannot tell, or whose light they cut.

    With `cut` the frame has 8 bits itself: light of 1 may be more.
    """
    threshold = min(config.contrast_threshold_pos, config.contrast_threshold_neg)
    step = np.log1p(1 / (255 * (frame.intensity + config.log_eps)))
    seen = np.isfinite(frame.nearest_depth_m)
    bright = frame.intensity > (1 - _ROUNDED if cut else 1 + _ROUNDED)
    return float(np.mean(seen & ((step > _COARSE * threshold) | bright)))


def glanced_beyond_8_bits(
    renderer: Renderer,
    motion: Motion,
    times_s: Sequence[float],
    config: PixelConfig,
    *,
    cut: bool,
) -> float:
    """The same of what all cameras see at some times, s; bodies stay where the last put them."""
    shares = []
    for t_s in times_s:
        renderer.at(t_s)
        T_world_body = motion.T_world_body(t_s)
        shares += [
            share_beyond_8_bits(renderer.glance(k, T_world_body), config, cut=cut)
            for k in range(len(renderer.rig))
        ]
    return float(np.mean(shares))
