"""Learned extraction: depth along each ray, and how wrong it may be, from the votes around it.

The extraction by focus (`emvs.depth.focus`) says where rays meet most sharply; the network looks at
the votes around that place, gives a depth of its own, and the expected error of both. Each pixel
takes the depth whose expected error is smaller, and the expected error chooses the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.focus import estimate_in_focus
from eventsweep.emvs.depth.precision import stated
from eventsweep.emvs.dsi.maxima import InFocus, Maximum
from eventsweep.emvs.dsi.method import Method
from eventsweep.emvs.learned.inputs import BATCH, Candidates, candidates, channels
from eventsweep.emvs.learned.kept_votes import KeptVotes
from eventsweep.emvs.learned.network import Network, network
from eventsweep.emvs.reference_view import ReferenceView, inverse_depth_at

AT_PX = 10.0
"""Disparity to which `learned_error_px` refers, px."""
LOG_ERROR_RANGE = -6.0, 4.0
"""What training can tell apart: from a four-hundredth of a pixel to some dozen."""
Floats = NDArray[np.float32]


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
    own_px: Floats
    log_error: Floats

    @property
    def disparity_px(self) -> Floats:
        """(M,) float32, of both depths the one whose expected error is smaller."""
        own = self.log_error[:, 0] < self.log_error[:, 1]
        return np.where(own, self.own_px, self.chosen.focus_px)

    @property
    def error_px(self) -> Floats:
        """(M,) float32, that expected error."""
        return np.asarray(np.exp(self.log_error.min(axis=1)), np.float32)

    @property
    def reliability(self) -> Floats:
        """(M,) float32 above 0, 1/px: the larger, the better."""
        return np.reciprocal(self.error_px)


def extract_learned(
    method: Method,
    votes: Maximum,
    focus: InFocus,
    kept: KeptVotes,
    view: ReferenceView,
    config: MapperConfig,
    baseline_m: float,
) -> DepthMap:
    """Turns one method's votes into its depth map.

    Args:
        method: how the votes are fused; its name is the map's.
        votes: first maximum of the fused volume; its values are the confidence.
        focus: where the fused rays and each camera's are most in focus.
        kept: every camera's votes in all planes.
        view: the reference view.
        config: weights, threshold, border.
        baseline_m: what disparities refer to (`emvs.depth.focus.parallax_baseline_m`), m.

    Raises:
        InputError: weights that cannot be read, or are of another network.
    """
    per_rho = baseline_m * view.camera.fx_px
    disparity_px = per_rho * view.rho.astype(np.float64)
    estimate = estimate_in_focus(votes, focus, disparity_px, config)
    chosen = candidates(votes, focus, estimate, disparity_px, config.border_px)
    net = network(config.learned_weights)
    found = judge(net, method, kept, chosen, disparity_px)
    at = chosen.rows, chosen.columns
    depth_m = np.reciprocal(inverse_depth_at(view.rho, estimate.position))
    depth_m[at] = per_rho / found.disparity_px
    mask = np.zeros(depth_m.shape, np.bool_)
    mask[at] = at_reference_px(found.reliability, found.disparity_px) >= 1 / config.learned_error_px
    reliability = np.zeros(depth_m.shape, np.float32)
    reliability[at] = found.reliability
    learnt = DepthMap(
        method=method.name,
        depth_m=depth_m,
        confidence=votes.value,
        mask=mask,
        argmax=focus.maximum.plane,
        rho=view.rho,
        t_us=view.t_us,
        T_world_rv=view.T_world_rv,
        camera=view.camera,
        reliability=reliability,
    )
    return stated(learnt, per_rho, config, net.precision(method.name))


def at_reference_px(reliability: Floats, disparity_px: Floats) -> Floats:
    """Reliability as it would be with the same rank at a disparity of `AT_PX`: what ranks pixels.

    With the same error in pixels near points are exact to millimetres and far ones to metres;
    ranked by the error in depth, far ones would never be reported. The square root of disparity
    stands between the two, as in the extraction by focus.

    Args:
        reliability: (...) 1/px.
        disparity_px: (...) of the same pixels, px.
    """
    scale = np.sqrt(np.maximum(disparity_px, np.float32(1e-3)) / np.float32(AT_PX))
    return np.asarray(reliability * scale, np.float32)


def judge(
    net: Network,
    method: Method,
    kept: KeptVotes,
    chosen: Candidates,
    disparity_px: NDArray[np.float64],
) -> Judgement:
    """Depth and expected errors of every candidate.

    Args:
        net: the network.
        method: how votes are fused.
        kept: every camera's votes in all planes.
        chosen: the candidates.
        disparity_px: (N,) disparity of each plane, px.
    """
    offset = np.empty(len(chosen), np.float32)
    log_error = np.empty((len(chosen), 2), np.float32)
    for first in range(0, len(chosen), BATCH):
        part = slice(first, first + BATCH)
        shares = channels(kept, method, chosen[part])
        offset[part], log_error[part] = net.judge(shares, chosen.cues[part])
    own_px = disparity_px[chosen.centres].astype(np.float32) - offset * chosen.sample_px
    # Beyond the planes there is no depth: the nearest and the farthest bound it.
    own_px = np.clip(own_px, np.float32(disparity_px.min()), np.float32(disparity_px.max()))
    np.clip(log_error, *LOG_ERROR_RANGE, out=log_error)
    return Judgement(chosen, own_px, log_error)
