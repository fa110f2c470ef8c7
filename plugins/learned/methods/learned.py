"""Learned extraction: depth along each ray, and how wrong it may be, from the votes around it.

The extraction by focus says where rays meet most sharply; the network looks at the votes around
that place, gives a depth of its own, and the expected error of both (`Judgement`).
Each pixel takes the depth whose expected error is smaller, and moves onto the plane through those
of its surface around it, as in the extraction by focus. The expected error chooses the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.focus import (
    estimate_in_focus,
    surface_disparity,
    surface_scatter_px,
)
from eventsweep.emvs.depth.kept_votes import KeptVotes
from eventsweep.emvs.depth.precision import Precision, stated, table_name
from eventsweep.emvs.dsi.fusion import Fusion
from eventsweep.emvs.dsi.method import MethodName
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.methods.method import Focus, Method, Swept
from eventsweep.emvs.reference_view import inverse_depth_at
from eventsweep.plugins.learned.networks.inputs import BATCH, Candidates, candidates, channels
from eventsweep.plugins.learned.networks.network import LOG_ERROR_RANGE, Network, network
from eventsweep.plugins.learned.networks.weights import files_of_weights, packaged

AT_PX = 10.0
"""Disparity to which `learned.error_px` refers, px."""
Float32s = NDArray[np.float32]


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


@dataclass(frozen=True, eq=False)
class Judgement:
    """What the network makes of a window's candidates.

    Attributes:
        chosen: the candidates.
        own_px: (M,) float32, the network's own depth of each, px of disparity.
        log_error: (M, 2) float32 natural logarithms of the expected errors, px of disparity: of
            that depth, and of the depth by focus.
    """

    chosen: Candidates
    own_px: Float32s
    log_error: Float32s

    @property
    def disparity_px(self) -> Float32s:
        """(M,) float32, of both depths the one whose expected error is smaller."""
        own = self.log_error[:, 0] < self.log_error[:, 1]
        return np.where(own, self.own_px, self.chosen.focus_px)

    @property
    def error_px(self) -> Float32s:
        """(M,) float32, that expected error."""
        return np.asarray(np.exp(self.log_error.min(axis=1)), np.float32)

    @property
    def reliability(self) -> Float32s:
        """(M,) float32 above 0, 1/px: the larger, the better."""
        return np.reciprocal(self.error_px)


def at_reference_px(reliability: Float32s, disparity_px: Float32s) -> Float32s:
    """Reliability as it would be with the same rank at a disparity of `AT_PX`: what ranks pixels.

    With the same error in pixels near points are exact to millimetres and far ones to metres;
    ranked by the error in depth, far ones would never be reported. The square root of disparity
    stands between the two, as in the extraction by focus.
    """
    scale = np.sqrt(np.maximum(disparity_px, np.float32(1e-3)) / np.float32(AT_PX))
    return np.asarray(reliability * scale, np.float32)


def on_own_surface(
    chosen: Candidates, disparity_px: Float32s, shape: tuple[int, ...]
) -> tuple[Float32s, Float32s]:
    """(M,) disparities on the planes through those around them, as in the extraction by focus.

    `disparity_px` is (M,) px, above 0; `shape` that of the image. Also returns the (H, W) scatter
    around those planes, px.
    """
    at = chosen.rows, chosen.columns
    image = np.zeros(shape, np.float32)
    image[at] = disparity_px
    fitted_px = surface_disparity(image, image > 0)
    return fitted_px[at], surface_scatter_px(image, fitted_px, image > 0)


def judge(
    net: Network,
    fusion: Fusion,
    kept: KeptVotes,
    chosen: Candidates,
    disparity_px: NDArray[np.float64],
) -> Judgement:
    """Depth and expected errors of every candidate; `disparity_px` is (N,), of each plane."""
    offset = np.empty(len(chosen), np.float32)
    log_error = np.empty((len(chosen), 2), np.float32)
    for first in range(0, len(chosen), BATCH):
        part = slice(first, first + BATCH)
        shares = channels(kept, fusion, chosen[part])
        offset[part], log_error[part] = net.judge(shares, chosen.cues[part])
    own_px = disparity_px[chosen.centres].astype(np.float32) - offset * chosen.sample_px
    # Beyond the planes there is no depth: the nearest and the farthest bound it.
    own_px = np.clip(own_px, np.float32(disparity_px.min()), np.float32(disparity_px.max()))
    np.clip(log_error, *LOG_ERROR_RANGE, out=log_error)
    return Judgement(chosen, own_px, log_error)
