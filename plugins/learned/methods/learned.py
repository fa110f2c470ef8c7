"""Learned extraction: depth along each ray, and how wrong it may be, from the votes around it.

The extraction by focus says where rays meet most sharply; the network looks at the votes around
that place, gives a depth of its own, and the expected error of both (`networks.judgement`).
Each pixel takes the depth whose expected error is smaller, and moves onto the plane through those
of its surface around it, as in the extraction by focus. The expected error chooses the pixels.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.focus import estimate_in_focus
from eventsweep.emvs.depth.precision import Precision, stated, table_name
from eventsweep.emvs.dsi.method import MethodName
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.methods.method import Focus, Method, Swept
from eventsweep.emvs.reference_view import inverse_depth_at
from eventsweep.plugins.learned.networks.inputs import candidates
from eventsweep.plugins.learned.networks.judgement import at_reference_px, judge, on_own_surface
from eventsweep.plugins.learned.networks.network import Network, network
from eventsweep.plugins.learned.networks.weights import files_of_weights, packaged


class Learned(Focus):
    """The extraction by focus, and a small network that looks at the votes around each pixel."""

    family = "Learned"
    grammar = "Learned/<F> or Learned/camK"
    summary = (
        "our own: Focus, and a small network that looks at the votes around, corrects the depth "
        "and says how wrong it may be"
    )
    examples: tuple[str, ...] = ("Learned/H", "Learned/cam0")
    calibrated = ("Learned/H", "Learned/cam")
    how = ", by focus and a network"
    keeps_votes = trained = True

    def check(self, config: MapperConfig) -> None:
        """Refuses weights that cannot be read, or are of another network."""
        network(config.learned.weights)

    def files(self, config: MapperConfig) -> tuple[Path, ...]:
        """The weights and their manifest."""
        return files_of_weights(config.learned.weights or packaged("learned"))

    def build(self, name: str, mcemvs: bool = False) -> Method:
        """The method of a name; it has no sub-intervals and no compatibility setting."""
        if mcemvs:
            raise InputError(
                f"{name} does not support the mcemvs setting: choose compatibility none"
            )
        if "@" in MethodName.of(name).variant:
            raise InputError(f"unknown method {name!r}: the names are {self.grammar}")
        return super().build(name)

    def extract(self, method: Method, swept: Swept, /) -> DepthMap:
        """Depth by focus, corrected where the network expects a smaller error of its own."""
        votes, focus = swept.result.maxima[method.name], swept.result.focus[method.name]
        view, config, per_rho_px = swept.view, swept.config, swept.known_per_rho_px
        disparity_px = per_rho_px * view.rho.astype(np.float64)
        estimate = estimate_in_focus(votes, focus, disparity_px, config)
        chosen = candidates(votes, focus, estimate, disparity_px, config.border_px)
        net = network(config.learned.weights)
        judged = judge(net, method.fusion, swept.votes_of_planes, chosen, disparity_px)
        at = chosen.rows, chosen.columns
        depth_m = np.reciprocal(inverse_depth_at(view.rho, estimate.position))
        own_px, scatter_px = judged.disparity_px, None
        if config.refines:
            own_px, scatter_px = on_own_surface(chosen, own_px, depth_m.shape)
        depth_m[at] = per_rho_px / own_px
        ranked = at_reference_px(judged.reliability, own_px)
        mask = np.zeros(depth_m.shape, np.bool_)
        mask[at] = ranked >= 1 / config.learned.error_px
        reliability = np.zeros(depth_m.shape, np.float32)
        reliability[at] = judged.reliability
        extracted = swept.new_map(method, focus.maximum, depth_m, mask, reliability)
        extracted = replace(extracted, scatter_px=scatter_px)
        return stated(extracted, per_rho_px, config, precision_of(net, method.name))


def precision_of(net: Network, method: str) -> Precision | None:
    """What the expected error of a method is worth, where the network's manifest says so."""
    table = net.weights.manifest.get("precision", {}).get(table_name(method))
    return None if table is None else Precision.from_json(table)


LEARNED = Learned()
