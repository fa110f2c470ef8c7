"""Votes of rays on the GPU: planes that are cast, checked and kept there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.dsi.voting import VoteCounts
from eventsweep.emvs.errors import InputError
from eventsweep.plugins.cuda import arrays, device, voting_kernels
from eventsweep.plugins.cuda.arrays import DeviceRays

Float32s = NDArray[np.float32]

# A lane of 32 bits takes 65 535 votes of 2^16 each. Where a voxel may have more, the check after
# the votes finds it, and they are cast again with fewer bits.
MOST_BITS, _FEWER, _FEWEST_BITS = 16, 4, 4

# What casts votes into sums, and makes votes of these
_FIXED = voting_kernels.vote_fixed, voting_kernels.settle_fixed
_NEAREST = voting_kernels.vote_nearest, voting_kernels.settle_nearest


class VoteVolume:
    """Planes of every volume on the GPU that votes are cast into, allocated once for all batches.

    `votes` are (V, planes, H * W) float32 there. With `nearest` a ray votes for the nearest pixel,
    and not bilinearly for four.
    """

    def __init__(
        self, volumes: int, planes: int, width_px: int, height_px: int, *, nearest: bool = False
    ) -> None:
        self._size, self._nearest = (width_px, height_px), nearest
        cells = width_px * height_px
        self.votes = arrays.empty((volumes, planes, cells), np.float32)
        self._sums = arrays.empty((planes, cells), np.int32 if nearest else np.int64)
        # per volume: votes inside, behind their camera, and the sum of all lanes; each per plane,
        # spread over slots
        self._counts = arrays.empty((volumes, 3 * planes, device.SLOTS), np.int64)

    def cast(self, rays: Sequence[DeviceRays], rho: Any, planes: int) -> list[VoteCounts]:
        """Fills `votes[:, :planes]` with the votes of every volume's rays in planes `rho`.

        Raises:
            InputError: more votes in one voxel than any scale can hold.
        """
        for volume, cast_rays in enumerate(rays):
            self._cast(volume, cast_rays, rho, planes, MOST_BITS)
        # Nothing above waits for the GPU; this does, once per batch.
        counts = self._counted(self._counts, planes)
        for volume, cast_rays in enumerate(rays):
            bits = MOST_BITS
            while not self._nearest and not _is_whole(counts[volume], bits):
                if bits == _FEWEST_BITS:
                    raise InputError(
                        f"more than {2**32 >> bits} votes in one voxel: choose voting nearest, a "
                        "shorter window or hot_pixels"
                    )
                bits -= _FEWER
                self._cast(volume, cast_rays, rho, planes, bits)
                counts[volume] = self._counted(self._counts[volume : volume + 1], planes)[0]
        return [_votes(*pair, planes) for pair in zip(rays, counts, strict=True)]

    def _cast(self, volume: int, rays: DeviceRays, rho: Any, planes: int, bits: int) -> None:
        sums, counts = self._sums[:planes], self._counts[volume]
        arrays.fill(sums, 0)
        arrays.fill(counts, 0)
        inside, behind, total = (counts[k * planes : (k + 1) * planes] for k in range(3))
        scale, settled = ((), ()) if self._nearest else ((bits,), (bits, total))
        vote, settle = _NEAREST if self._nearest else _FIXED
        for block in rays.blocks:
            vote[device.each(block.shape[1])](block, rho, *self._size, *scale, sums, inside, behind)
        grid = device.strided(sums.shape[1], planes)
        settle[grid](sums, self.votes[volume, :planes], *settled)

    def _counted(self, counts: Any, planes: int) -> NDArray[np.int64]:
        """(V, 3, planes) votes inside, behind, and the sum of all lanes."""
        every: NDArray[np.int64] = arrays.down(counts).sum(axis=2)
        return every[:, : 3 * planes].reshape(-1, 3, planes)

    def on_host(self, planes: int) -> Float32s:
        """The first `planes` planes as (V, planes, H, W), copied from the GPU."""
        width, height = self._size
        images = [arrays.down(self.votes[v, :planes]) for v in range(len(self.votes))]
        return np.stack(images).reshape(len(images), planes, height, width)


def _is_whole(counts: NDArray[np.int64], bits: int) -> bool:
    """Whether no lane ran over.

    The lanes of one vote sum to 2^bits. A lane that runs over loses 2^32, or gives 1 for 2^32 to
    the lane above it: then the sum is too small, and nothing makes it larger again.
    """
    inside, _, total = counts
    return bool(np.array_equal(total, inside << bits))


def _votes(rays: DeviceRays, counts: NDArray[np.int64], planes: int) -> VoteCounts:
    counted, hidden = int(counts[0].sum()), int(counts[1].sum())
    return VoteCounts(counted, len(rays) * planes - counted - hidden, hidden)
