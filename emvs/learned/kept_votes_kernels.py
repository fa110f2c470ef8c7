"""The compiled loops of kept votes: into 8-bit floats, and patches out of them."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

import numpy as np
from numba import njit, prange

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

_ONE = np.float32(1)
_SHIFT, _HALF = np.int32(19), np.int32(1 << 18)  # 4 of the mantissa's 23 bits stay, rounded
_ZERO_EXPONENT = np.int32(127 << 4)


@njit(parallel=True, cache=True)
def encode(votes, scratch, codes):
    """Fills `codes` with the votes of one camera as `emvs.learned.kept_votes` codes them.

    Arrays:
        votes: (P, H, W) float32, 0 or more, each row contiguous.
        scratch: (H, W) float32.
        codes: (P, H, W) uint8, filled.
    """
    planes, height, _ = votes.shape
    for y in prange(height):
        more, bits = scratch[y], scratch[y].view(np.int32)
        for p in range(planes):
            row, out = votes[p, y], codes[p, y]
            for x in range(len(out)):
                more[x] = row[x] + _ONE
            for x in range(len(out)):
                code = ((bits[x] + _HALF) >> _SHIFT) - _ZERO_EXPONENT
                out[x] = np.uint8(code if code < 255 else 255)


@njit(cache=True)
def _gather(codes, row, column, centre, stride, lane, out):
    """The codes around one pixel into one lane of out (D, S, S, L); 0 on planes there are not."""
    depth, side = out.shape[:2]
    for d in range(depth):
        plane = centre + (d - depth // 2) * stride
        if plane < 0 or plane >= len(codes):
            out[d, :, :, lane] = 0
            continue
        for y in range(side):
            line = codes[plane, row - side // 2 + y]
            for x in range(side):
                out[d, y, x, lane] = line[column - side // 2 + x]


@njit(parallel=True, cache=True)
def patches(codes, rows, columns, centres, strides, out):
    """Fills `out` with the votes around pixels, many pixels side by side.

    Arrays:
        codes: (C, N, H, W) uint8.
        rows, columns: (M,) int64, the pixels; all their neighbours must be in the image.
        centres: (M,) int64, the plane in the middle of each patch.
        strides: (M,) int64, planes from one sample of the patch to the next.
        out: (C, B, D, S, S, L) float32; pixel m is lane m % L of block m // L. Planes that there
            are not have no votes.
    """
    depth, side, _, lanes = out.shape[2:]
    for b in prange(out.shape[1]):
        first = b * lanes
        gathered = np.zeros((depth, side, side, lanes), np.uint8)
        for c in range(len(codes)):
            for m in range(first, min(first + lanes, len(rows))):
                _gather(codes[c], rows[m], columns[m], centres[m], strides[m], m - first, gathered)
            _decode(gathered.reshape(-1), out[c, b].reshape(-1))


@njit(cache=True)
def _decode(codes, out):
    """Votes of codes, by the same shifts as in `encode`, the other way."""
    bits = out.view(np.int32)
    for k in range(len(out)):
        bits[k] = (np.int32(codes[k]) + _ZERO_EXPONENT) << _SHIFT
    for k in range(len(out)):
        out[k] -= _ONE
