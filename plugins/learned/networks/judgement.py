"""What the network makes of the candidates: a depth of its own, and how wrong both may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth.focus import surface_disparity, surface_scatter_px
from eventsweep.emvs.depth.kept_votes import KeptVotes
from eventsweep.emvs.dsi.fusion import Fusion
from eventsweep.plugins.learned.networks.inputs import BATCH, Candidates, channels
from eventsweep.plugins.learned.networks.network import Network

AT_PX = 10.0
"""Disparity to which `learned.error_px` refers, px."""
LOG_ERROR_RANGE = -6.0, 4.0
"""What training can distinguish: from a four-hundredth of a pixel to some dozen."""
Float32s = NDArray[np.float32]


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
