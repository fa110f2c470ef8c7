"""The space sweep: votes of one camera's rays in given planes, a few planes at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.dsi import voting_kernels
from eventsweep.emvs.dsi.rays import Rays
from eventsweep.emvs.utils.runtime import in_threads
from eventsweep.emvs.utils.vectors_kernels import aligned

# Planes that share one pass over the rays, and so are read and written in turns: with one, the
# sweep waits for the stream of rays.
PASS_PLANES = 4
# Planes that are taken in at once, so that the maxima are read and written once for all of them.
_FOLD_PLANES = 8
# Scratch planes hold 512 MB at most: 17 planes of 8 volumes of 1 Mpx (Alg. 2, 4 sub-intervals).
_SCRATCH_PX = 128 << 20


@dataclass(frozen=True)
class VoteCounts:
    """Votes of one camera, summed over planes.

    Attributes:
        counted: votes inside the image.
        outside: votes that miss the image.
        behind: votes in planes that lie behind the event's camera.
    """

    counted: int = 0
    outside: int = 0
    behind: int = 0

    def __add__(self, other: VoteCounts) -> VoteCounts:
        return VoteCounts(
            self.counted + other.counted, self.outside + other.outside, self.behind + other.behind
        )


class Scratch:
    """Planes that votes are cast into, allocated once and used for every batch.

    Attributes:
        votes: (C, P, cells) float32; the first `height * width` cells of a plane are the image.
        nearest: whether a ray votes for the nearest pixel, and not bilinearly for four.
    """

    def __init__(
        self, cameras: int, planes: int, width_px: int, height_px: int, *, nearest: bool = False
    ) -> None:
        self.width_px, self.height_px, self.nearest = width_px, height_px, nearest
        cells = voting_kernels.grid_cells(width_px, height_px)
        self.votes: NDArray[np.float32] = aligned(cameras * planes * cells).reshape(
            cameras, planes, cells
        )
        self._cell = np.empty((planes, voting_kernels.CHUNK), np.int32)
        self._fx = np.empty((planes, voting_kernels.CHUNK), np.float32)
        self._fy = np.empty((planes, voting_kernels.CHUNK), np.float32)

    def images(self, planes: int) -> NDArray[np.float32]:
        """The first `planes` planes as (C, planes, H, W) views."""
        pixels = self.height_px * self.width_px
        image = self.votes[:, :planes, :pixels]
        return image.reshape(len(self.votes), planes, self.height_px, self.width_px)

    def cast(self, camera: int, rays: Rays, rho: NDArray[np.float32]) -> VoteCounts:
        """Fills `votes[camera, :len(rho)]` with the votes of `rays` in planes `rho`.

        A vote counts only where all four pixels around it lie in the image.

        Raises:
            ValueError: more planes than the scratch has.
        """
        if len(rho) > self.votes.shape[1]:
            raise ValueError(f"{len(rho)} planes, scratch has {self.votes.shape[1]}")
        # Fewer planes than all threads together take in one pass are shared out among them.
        per_pass = min(PASS_PLANES, max(1, -(-len(rho) // numba.get_num_threads())))
        passes = -(-len(rho) // per_pass)
        inside, behind = np.empty(len(rho), np.int64), np.empty(len(rho), np.int64)
        in_threads(
            voting_kernels.vote, passes, *rays.columns, rays.c_z_max, rho,
            (self.width_px, self.height_px), per_pass, self.nearest,
            self._cell[:passes], self._fx[:passes], self._fy[:passes],
            self.votes[camera, : len(rho)], inside, behind,
        )  # fmt: skip
        counted, hidden = int(inside.sum()), int(behind.sum())
        return VoteCounts(counted, len(rays) * len(rho) - counted - hidden, hidden)


def batch_planes(planes: int, threads: int, plane_px: int = 1, volumes: int = 1) -> int:
    """How many planes make one batch: whole passes of every thread, enough for the fold.

    Where one batch of all `volumes` of `plane_px` pixels would be too large, it shrinks.
    """
    one_pass = threads * PASS_PLANES
    wanted = max(1, _FOLD_PLANES // one_pass) * one_pass
    fit = max(1, _SCRATCH_PX // max(1, volumes * plane_px))
    return min(planes, wanted, fit)
