"""Votes of whole volumes, kept in a byte per cell, for methods that look at more than one plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth import kept_votes_kernels
from eventsweep.emvs.utils.runtime import in_threads

LANES = kept_votes_kernels.LANES
"""Pixels side by side in patches."""
_CODES = 256

Float32s = NDArray[np.float32]
Indices = NDArray[np.int64]


def votes_of_codes() -> Float32s:
    """What each of the 256 codes stands for: (256,) float32 votes, rising.

    A code is a float of 8 bits: 4 for the exponent and 4 for the mantissa of votes + 1, so that
    steps are a sixteenth of a vote where there are few, and 3 to 6 % where there are many. The
    largest is 63487 votes; a cell with more has that.
    """
    bits = (np.arange(_CODES, dtype=np.int32) + (127 << 4)) << 19
    return bits.view(np.float32) - np.float32(1)


class KeptVotes:
    """The votes of every camera in all planes: a quarter of the memory that volumes would take.

    Where each polarity has volumes of its own, they are kept together. `codes` are (C, N, H, W)
    uint8, see `votes_of_codes`.
    """

    def __init__(
        self, cameras: int, planes: int, height_px: int, width_px: int, polarities: int = 1
    ) -> None:
        pixels = planes * height_px * width_px
        self._all = np.zeros((cameras, pixels + kept_votes_kernels.SPARE), np.uint8)
        self.codes = self._all[:, :pixels].reshape(cameras, planes, height_px, width_px)
        self._polarities = polarities

    def take(self, first: int, images: Float32s) -> None:
        """Takes in (V, P, H, W) votes, planes `first` and on; sub-intervals are summed."""
        parts = images.reshape(self._polarities, len(self.codes), -1, *images.shape[1:])
        for camera, codes in enumerate(self.codes):
            whole = parts[:, camera].reshape(-1, *images.shape[1:])
            votes = whole[0] if len(whole) == 1 else whole.sum(axis=0)
            out = codes[first : first + len(votes)]
            in_threads(kept_votes_kernels.encode, votes.shape[1], votes, out)

    def patches(
        self, rows: Indices, columns: Indices, centres: Indices, strides: Indices,
        depth: int, side_px: int,
    ) -> Float32s:  # fmt: skip
        """The votes around (M,) pixels, at least half a side from the image's rim.

        Args:
            rows: of the pixels.
            columns: likewise.
            centres: the plane in the middle of each patch.
            strides: planes from one sample to the next.
            depth: samples along the ray, depth // 2 of them before the centre.
            side_px: rows and columns of a patch, odd.

        Returns:
            (C, B, depth, side, side, L) float32: pixel m is lane m % L of block m // L. 0 on planes
                that there are not, and in lanes that are left over.
        """
        blocks = -(-len(rows) // LANES)
        shape = (len(self.codes), blocks, depth, side_px, side_px, LANES)
        out = np.empty(shape, np.float32)
        # Those of `np.nonzero` are columns of one array, and would have a kernel of their own.
        where = map(np.ascontiguousarray, (rows, columns, centres, strides))
        in_threads(kept_votes_kernels.patches, blocks, self._all, self.codes.shape[1:], *where, out)
        return out
