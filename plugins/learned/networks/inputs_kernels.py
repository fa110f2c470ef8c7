"""The compiled loop of the network's inputs: votes of cameras into shares of the largest."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg, var-annotated"

import numpy as np
from numba import njit, prange

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.depth.kept_votes_kernels import LANES
from eventsweep.emvs.utils.vectors_kernels import WIDTH, larger, load, splat, store

_LEAST_VOTES, _ONE, _ZERO = np.float32(1e-6), np.float32(1), np.float32(0)


@njit(cache=True)
def _one_over_largest(votes, lane, cells):
    """1 over the largest votes of `WIDTH` lanes: votes (cells L), the lanes from number `lane`."""
    largest = splat(_LEAST_VOTES)
    for k in range(cells):
        largest = larger(load(votes, k * LANES + lane), largest)
    return splat(_ONE) / largest


@njit(cache=True)
def _cell(votes, cameras, at, apart, scale, out, to, channel):
    """The shares of one cell, for `WIDTH` lanes; cameras lie `apart`, channels `channel` apart."""
    count = len(cameras) // apart
    first = load(cameras, at)
    others = load(cameras, at + apart) if count > 1 else first
    for c in range(2, count):
        others = others + load(cameras, at + c * apart)
    store(out, to, load(votes, at) * scale)
    store(out, to + channel, first * scale)
    among = splat(_ONE / np.float32(max(count - 1, 1)))
    store(out, to + 2 * channel, others * (among * scale))


@njit(parallel=True, cache=True)
def shares(fused, cameras, out):
    """Fills `out` with fused votes, the first camera's and the mean of the others, as shares.

    Arrays:
        fused: (B, D, S, S, L) float32.
        cameras: (C, B, D, S, S, L) float32; one alone is the others, too.
        out: (B, 3, S, S, D + 2, L) float32, filled: votes over the largest fused one of that lane,
            and nothing at both ends of each ray.
    """
    blocks, depth, side = fused.shape[:3]
    cells, ray = depth * side * side, (depth + 2) * LANES
    votes, every = fused.reshape(fused.size), cameras.reshape(cameras.size)
    filled, channel = out.reshape(out.size), side * side * ray
    for b in prange(blocks):
        out[b, :, :, :, 0] = _ZERO
        out[b, :, :, :, depth + 1] = _ZERO
        first, to = b * cells * LANES, 3 * b * channel
        for lane in range(0, LANES, WIDTH):
            scale = _one_over_largest(votes[first : first + cells * LANES], lane, cells)
            for d in range(depth):
                for place in range(side * side):
                    at = first + (d * side * side + place) * LANES + lane
                    here = to + place * ray + (d + 1) * LANES + lane
                    _cell(votes, every, at, len(votes), scale, filled, here, channel)
