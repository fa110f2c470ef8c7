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


@njit(parallel=True, cache=True)
def patches(codes, table, rows, columns, centres, strides, out):
    """Fills `out` with the votes around pixels, many pixels side by side.

    Arrays:
        codes: (C, N, H, W) uint8.
        table: (256,) float32, what each code stands for.
        rows, columns: (M,) int64, the pixels; all their neighbours must be in the image.
        centres: (M,) int64, the plane in the middle of each patch.
        strides: (M,) int64, planes from one sample of the patch to the next.
        out: (C, B, D, S, S, L) float32; pixel m is lane m % L of block m // L. Planes that there
            are not have no votes.
    """
    cameras, planes = codes.shape[:2]
    blocks, depth, side, _, lanes = out.shape[1:]
    reach, radius = depth // 2, side // 2
    for b in prange(blocks):
        first = b * lanes
        used = min(lanes, len(rows) - first)
        out[:, b, :, :, :, used:] = 0
        for c in range(cameras):
            for d in range(depth):
                for y in range(side):
                    for x in range(side):
                        cell = out[c, b, d, y, x]
                        for lane in range(used):
                            m = first + lane
                            plane = centres[m] + (d - reach) * strides[m]
                            if plane < 0 or plane >= planes:
                                cell[lane] = 0
                                continue
                            row, column = rows[m] - radius + y, columns[m] - radius + x
                            cell[lane] = table[codes[c, plane, row, column]]
