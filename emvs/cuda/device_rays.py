"""Rays that are on the GPU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from emvs.cuda import arrays
from emvs.rays import RayCounts, Rays
from emvs.split import total


@dataclass(frozen=True, eq=False)
class DeviceRays:
    """Rays of one camera in the reference view, on the GPU.

    Attributes:
        blocks: each (5, N) float32 on the GPU, rows a_u, b_u, a_v, b_v, c_z as in `Rays`; events
            that do not vote have NaN.
        counts: what became of the events.
    """

    blocks: tuple[Any, ...]
    counts: RayCounts

    @classmethod
    def of(cls, rays: Rays) -> DeviceRays:
        """Uploads rays."""
        if not len(rays):
            return cls((), rays.counts)
        return cls((arrays.up(np.stack(rays.columns)),), rays.counts)

    @classmethod
    def joined(cls, parts: Sequence[DeviceRays]) -> DeviceRays:
        """All rays of several parts; nothing is copied."""
        blocks = tuple(block for part in parts for block in part.blocks)
        return cls(blocks, total([part.counts for part in parts]))

    def __len__(self) -> int:
        return self.counts.rays
