"""The GPU's loops of the sweep: votes into sums of 64 bits, and sums to votes.

A sum of 64 bits carries two lanes of 32: cell `c` of `sums` holds, times 2^bits, what rays whose
left column is that of `c` give to `c` (lower lane) and to its right neighbour (upper lane). So a
bilinear vote is two atomic additions of integers, and their order cannot change a bit.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, attr-defined"

import numpy as np
from numba import cuda

from eventsweep.plugins.cuda.device import SLOTS, product

_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)
_NOWHERE = np.float32(np.nan)
_LANE = np.int64(0xFFFFFFFF)
_UPPER = np.int64(32)
_UNIT = np.int64(1)


@cuda.jit(device=True)
def _add_row(sums, p, cell, row, share, bits):
    """Adds integer `row`, of which `share` / 2^bits goes to the right neighbour, to two lanes."""
    right = (row * share + (_UNIT << bits >> _UNIT)) >> bits
    cuda.atomic.add(sums, (p, cell), (row - right) + (right << _UPPER))


@cuda.jit(device=True)
def _add_fixed(sums, p, u, v, width, bits):
    column, row = np.int64(u), np.int64(v)
    scale = np.float32(_UNIT << bits)
    # 0..2^bits; the four integers of a vote sum to exactly 2^bits
    right = np.int64((u - np.float32(column)) * scale + _HALF)
    down = np.int64((v - np.float32(row)) * scale + _HALF)
    cell = row * width + column
    _add_row(sums, p, cell, (_UNIT << bits) - down, right, bits)
    _add_row(sums, p, cell + width, down, right, bits)


@cuda.jit(device=True)
def _ray(rays, k):
    """Ray `k` in registers; beyond the last one, NaN."""
    if k < rays.shape[1]:
        return rays[0, k], rays[1, k], rays[2, k], rays[3, k], rays[4, k]
    return _NOWHERE, _ZERO, _NOWHERE, _ZERO, _ZERO


@cuda.jit(device=True)
def _votes_at(u, v, width, height, c_z, rho, p, slot, behind):
    """Whether a ray votes: all four pixels around (u, v) in the image, in front of its camera."""
    if _ONE - product(c_z, rho) <= _ZERO:
        cuda.atomic.add(behind, (p, slot), np.int64(1))
        return False
    last_column, last_row = np.float32(width - 1), np.float32(height - 1)
    return (u >= _ZERO) & (v >= _ZERO) & (u < last_column) & (v < last_row)  # never for NaN


@cuda.jit(device=True)
def _tally(inside, p, ok):
    """Counts a block's votes by one addition; every thread of the block must come here."""
    count = cuda.syncthreads_count(np.int32(ok))
    if cuda.threadIdx.x == 0:
        cuda.atomic.add(inside, (p, cuda.blockIdx.x & (SLOTS - 1)), np.int64(count))


# The two below: a thread per ray, all planes of the batch while its ray is in registers.
#   rays: (5, N) float32, rows a_u, b_u, a_v, b_v, c_z; a ray of NaN never votes.
#   rho: (P,) float32 planes, 1/m.
#   width, height: px.
#   sums: (P, H * W) zeros, added to.
#   inside, behind: (P, SLOTS) int64 zeros, added to: votes counted, votes behind their camera.


@cuda.jit(cache=True)
def vote_fixed(rays, rho, width, height, bits, sums, inside, behind):
    """Bilinear votes times 2^bits, in two lanes of int64; see the module."""
    k = cuda.grid(1)
    a_u, b_u, a_v, b_v, c_z = _ray(rays, k)
    for p in range(len(rho)):
        u, v = a_u + product(rho[p], b_u), a_v + product(rho[p], b_v)
        ok = _votes_at(u, v, width, height, c_z, rho[p], p, k & (SLOTS - 1), behind)
        if ok:
            _add_fixed(sums, p, u, v, width, bits)
        _tally(inside, p, ok)


@cuda.jit(cache=True)
def vote_nearest(rays, rho, width, height, sums, inside, behind):
    """Votes for the nearest pixel, counted in int32."""
    k = cuda.grid(1)
    a_u, b_u, a_v, b_v, c_z = _ray(rays, k)
    for p in range(len(rho)):
        u, v = a_u + product(rho[p], b_u), a_v + product(rho[p], b_v)
        ok = _votes_at(u, v, width, height, c_z, rho[p], p, k & (SLOTS - 1), behind)
        if ok:
            cell = np.int64(v + _HALF) * width + np.int64(u + _HALF)
            cuda.atomic.add(sums, (p, cell), np.int32(1))
        _tally(inside, p, ok)


@cuda.jit(cache=True)
def settle_fixed(sums, votes, bits, total):
    """Sums of two lanes to float32 votes, and all lanes added up; the grid is (blocks, P).

    Arrays:
        sums: (P, cells) int64, as `vote_fixed` leaves it.
        votes: (P, cells) float32, filled.
        total: (P, SLOTS) int64 zeros, added to.
    """
    p, c = cuda.blockIdx.y, cuda.grid(1)
    slot = c & (SLOTS - 1)
    step = _ONE / np.float32(_UNIT << bits)
    mine = np.int64(0)
    while c < sums.shape[1]:
        both = sums[p, c] & _LANE
        if c > 0:  # nothing begins in the last column, so the left of a row's first cell is 0
            both += (sums[p, c - 1] >> _UPPER) & _LANE
        votes[p, c] = np.float32(both) * step
        mine += both
        c += cuda.gridDim.x * cuda.blockDim.x
    cuda.atomic.add(total, (p, slot), mine)


@cuda.jit(cache=True)
def settle_nearest(sums, votes):
    """Counts in int32 to float32 votes; the grid is (blocks, P)."""
    p, c = cuda.blockIdx.y, cuda.grid(1)
    while c < sums.shape[1]:
        votes[p, c] = np.float32(sums[p, c])
        c += cuda.gridDim.x * cuda.blockDim.x
