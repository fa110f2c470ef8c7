"""What the extraction by focus found, and which pixels of it to keep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs.depthmap import without_border

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Found:
    """What the extraction found.

    Attributes:
        position: (H, W) float32 plane index, fractional.
        confidence: (H, W) float32 maximum of the fused volume, votes.
        candidate: (H, W) bool, where that stands out from its surroundings.
        agreement: (H, W) float32 in 0..1, of the cameras with each other; 1 with a single camera.
        support: (H, W) float32 in 0..1, share of the candidates around that have this depth too.
        inside: (H, W) float32 in 0..1, near 0 where the pixel lies beyond its surface's edge.
        ray: (H, W) float32 in 0..1, near 0 where the votes' plain maximum lies elsewhere.
        strength: (H, W) float32 in 0..1, 0.5 where there are as many votes as at half of the
            candidates.
    """

    position: Floats
    confidence: Floats
    candidate: Mask
    agreement: Floats
    support: Floats
    inside: Floats
    ray: Floats
    strength: Floats

    @property
    def reliability(self) -> Floats:
        """(H, W) float32 in 0..1: the product, support squared; 0 where there is no candidate."""
        product = self.agreement * self.support**2 * self.inside * self.ray * self.strength
        return np.where(self.candidate, product, np.float32(0))


def most_reliable(found: Found, points: int, border_px: int) -> Mask:
    """The (H, W) mask of the `points` most reliable candidates, or of all if there are fewer.

    Equal reliability is decided by confidence, then by the order of pixels.

    Args:
        found: the extraction.
        points: number of pixels to keep.
        border_px: rim of the image that reports no depth, px.
    """
    allowed = np.flatnonzero(without_border(found.candidate, border_px))
    reliability, confidence = found.reliability.ravel()[allowed], found.confidence.ravel()[allowed]
    kept = allowed[np.lexsort((allowed, -confidence, -reliability))[: max(points, 0)]]
    mask = np.zeros(found.candidate.shape, np.bool_)
    mask.flat[kept] = True
    return mask


def at_least(found: Found, reliability: float, border_px: int) -> Mask:
    """The (H, W) mask of candidates with at least this reliability."""
    return without_border(found.candidate & (found.reliability >= reliability), border_px)
