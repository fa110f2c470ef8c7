"""Pixels' arrays side by side, as the compiled loops of both networks read them."""

import numpy as np

from eventsweep.emvs.depth.kept_votes import LANES


def in_blocks(pixels):
    """(M, ...) arrays of pixels as (B, ..., LANES)."""
    blocks = -(-len(pixels) // LANES)
    out = np.zeros((blocks * LANES, *pixels.shape[1:]), np.float32)
    out[: len(pixels)] = pixels
    return np.ascontiguousarray(np.moveaxis(out.reshape(blocks, LANES, *out.shape[1:]), 1, -1))


def as_rays(patches):
    """(M, 3, DEPTH, SIDE_PX, SIDE_PX) patches as `networks.inputs.channels` gives them."""
    ends = ((0, 0), (0, 0), (0, 0), (0, 0), (1, 1))
    return in_blocks(np.pad(np.moveaxis(patches, 2, -1), ends))
