"""Depth by focus: where the fused rays are most in focus; reliability chooses the pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.focus import at_least, estimate_in_focus
from eventsweep.emvs.depth.precision import stated
from eventsweep.emvs.methods.method import Extraction, Method, Swept
from eventsweep.emvs.reference_view import inverse_depth_at


class Focus(Extraction):
    """The extraction of `emvs.depth.focus`; no median."""

    family = "Focus"
    grammar = "Focus/<F>, Focus/camK or Focus/<an Algorithm 2, such as AtHc@4>"
    summary = (
        "our own: depth where the fused rays are most in focus, kept where cameras and neighbours "
        "agree; camK: one camera, without agreement"
    )
    examples: tuple[str, ...] = ("Focus/H", "Focus/cam0", "Focus/AtHc@4")
    how = ", by focus"
    per_camera = needs_baseline = True

    def measure(self, config: MapperConfig) -> str:
        """The focus measure of the configuration."""
        return config.focus.measure

    def extract(self, method: Method, swept: Swept, /) -> DepthMap:
        """Depth where the rays are most in focus, at candidates of enough reliability."""
        votes, focus = swept.result.maxima[method.name], swept.result.focus[method.name]
        view, config, per_rho_px = swept.view, swept.config, swept.known_per_rho_px
        estimate = estimate_in_focus(votes, focus, per_rho_px * view.rho, config)
        depth_m = np.reciprocal(inverse_depth_at(view.rho, estimate.position))
        mask = at_least(estimate, config.focus.reliability, config.border_px)
        extracted = swept.new_map(method, focus.maximum, depth_m, mask, estimate.reliability)
        return stated(replace(extracted, scatter_px=estimate.scatter_px), per_rho_px, config)


FOCUS = Focus()
