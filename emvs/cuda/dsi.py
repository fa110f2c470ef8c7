"""One camera's whole ray-density volume by the GPU; the mapper never needs it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.cuda import arrays
from emvs.cuda.ballot import Ballot
from emvs.cuda.device_rays import DeviceRays
from emvs.rays import Rays
from emvs.sweep import VoteCounts


def dsi(
    rays: Rays, rho: NDArray[np.float32], width_px: int, height_px: int, *, sums: str = "fixed"
) -> tuple[NDArray[np.float32], VoteCounts]:
    """Builds a volume as `emvs.sweep.dsi` does.

    Args:
        rays: the camera's rays.
        rho: (N,) float32 planes, 1/m.
        width_px: columns of the reference view.
        height_px: rows of the reference view.
        sums: `fixed`, `float` or `nearest`.

    Returns:
        (N, H, W) float32 votes, and what was counted.
    """
    ballot = Ballot(1, len(rho), width_px, height_px, sums=sums)
    (counts,) = ballot.cast([DeviceRays.of(rays)], arrays.up(rho), len(rho))
    return ballot.on_host(len(rho))[0], counts
