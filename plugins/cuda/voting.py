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

_KERNELS = {
    "fixed": (np.int64, voting_kernels.vote_fixed, voting_kernels.settle_fixed),
    "float": (np.float32, voting_kernels.vote_float, voting_kernels.settle_plain),
    "nearest": (np.int32, voting_kernels.vote_nearest, voting_kernels.settle_plain),
}


class VoteVolume:
    """Planes of every volume on the GPU that votes are cast into, allocated once for all batches.

    `sums` says how: `fixed`, `float` or `nearest`; `votes` are (V, planes, H * W) float32 there.
    """

    def __init__(
        self, volumes: int, planes: int, width_px: int, height_px: int, *, sums: str = "fixed"
    ) -> None:
        self._size, self._exact = (width_px, height_px), sums == "fixed"
        cells = width_px * height_px
        dtype, self._vote, self._settle = _KERNELS[sums]
        self.votes = arrays.empty((volumes, planes, cells), np.float32)
        self._sums = arrays.empty((planes, cells), dtype)
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
            while self._exact and not _is_whole(counts[volume], bits):
                bits = _fewer(bits)
                self._cast(volume, cast_rays, rho, planes, bits)
                counts[volume] = self._counted(self._counts[volume : volume + 1], planes)[0]
        return [_votes(*pair, planes) for pair in zip(rays, counts, strict=True)]

    def _cast(self, volume: int, rays: DeviceRays, rho: Any, planes: int, bits: int) -> None:
        cells = self._sums.shape[1]
        sums, counts = self._sums[:planes], self._counts[volume]
        arrays.clear(sums)
        arrays.clear(counts)
        inside, behind, total = (counts[k * planes : (k + 1) * planes] for k in range(3))
        scale = (bits,) if self._exact else ()
        for block in rays.blocks:
            self._vote[device.each(block.shape[1])](
                block, rho, *self._size, *scale, sums, inside, behind
            )
        settled = (bits, total) if self._exact else ()
        self._settle[device.strided(cells, planes)](sums, self.votes[volume, :planes], *settled)

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


def _fewer(bits: int) -> int:
    if bits == _FEWEST_BITS:
        raise InputError(
            f"more than {2**32 >> bits} votes in one voxel: choose voting_precision float, a "
            "shorter window or hot_pixels"
        )
    return bits - _FEWER


def _votes(rays: DeviceRays, counts: NDArray[np.int64], planes: int) -> VoteCounts:
    counted, hidden = int(counts[0].sum()), int(counts[1].sum())
    return VoteCounts(counted, len(rays) * planes - counted - hidden, hidden)
