"""The compiled loops of kept votes: into 8-bit floats, and patches out of them."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg, var-annotated"

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.utils.vectors_kernels import WIDTH, address, everywhere

LANES = 2 * WIDTH if WIDTH > 8 else WIDTH
"""Pixels side by side in patches. With long vectors come twice as many registers, for two each."""
_ONE = np.float32(1)
_SHIFT, _HALF = np.int32(19), np.int32(1 << 18)  # 4 of the mantissa's 23 bits stay, rounded
_ZERO_EXPONENT = np.int32(127 << 4)
_INT32 = ir.IntType(32)
_WORDS = ir.VectorType(_INT32, WIDTH)
SPARE = 64
"""Codes behind the last one: three may be read, four at a time; a cache line is easier to skip."""


@njit(cache=True, nogil=True)
def encode(start, stop, votes, codes):
    """Fills `codes` with the votes of one camera as `emvs.depth.kept_votes` codes them.

    Arrays:
        start, stop: the rows to encode here, of H.
        votes: (P, H, W) float32, 0 or more, each row contiguous.
        codes: (P, H, W) uint8, filled.
    """
    planes, _, width = votes.shape
    more = np.empty(width, np.float32)
    bits = more.view(np.int32)
    for y in range(start, stop):
        for p in range(planes):
            row, out = votes[p, y], codes[p, y]
            for x in range(len(out)):
                more[x] = row[x] + _ONE
            for x in range(len(out)):
                code = ((bits[x] + _HALF) >> _SHIFT) - _ZERO_EXPONENT
                out[x] = np.uint8(code if code < 255 else 255)


@intrinsic
def _word(_typing, codes, _index):
    """Four codes from that number of a contiguous 1-D array on, as a uint32; unchecked."""

    def codegen(context, builder, signature, args):
        place = address(context, builder, signature.args[0], *args, _INT32)
        return builder.load(place, align=1)

    return types.uint32(codes, types.intp), codegen


@njit(cache=True, nogil=True)
def _gather(codes, size, pixel, lane, words):
    """The codes around one pixel into one lane of words (D, S, W, L); 0 on planes there are not.

    A row of a patch is `W` words of four codes; of the last one some may be behind it.
    """
    planes, height, width = size
    row, column, centre, stride = pixel
    depth, side, count = words.shape[:3]
    for d in range(depth):
        plane = centre + (d - depth // 2) * stride
        if plane < 0 or plane >= planes:
            words[d, :, :, lane] = 0
            continue
        at = (plane * height + row - side // 2) * width + column - side // 2
        for y in range(side):
            for w in range(count):
                words[d, y, w, lane] = _word(codes, at + y * width + 4 * w)


@intrinsic
def _votes(_typing, words, _at, _byte, out, _to):
    """Votes of one code of each of `WIDTH` words, by the same shifts as in `encode`; unchecked."""

    def codegen(context, builder, signature, args):
        def vector(number):
            return ir.Constant(_WORDS, [int(number)] * WIDTH)

        source = address(context, builder, signature.args[0], *args[:2], _WORDS)
        bits = builder.mul(builder.trunc(args[2], _INT32), _INT32(8))
        codes = builder.lshr(builder.load(source, align=4), everywhere(builder, bits, _WORDS))
        codes = builder.and_(codes, vector(255))
        bits = builder.shl(builder.add(codes, vector(_ZERO_EXPONENT)), vector(_SHIFT))
        floats = ir.VectorType(ir.FloatType(), WIDTH)
        one = ir.Constant(floats, [1.0] * WIDTH)
        votes = builder.fsub(builder.bitcast(bits, floats), one)
        target = address(context, builder, signature.args[3], *args[3:], floats)
        builder.store(votes, target, align=4)
        return context.get_dummy_value()

    return types.void(words, types.intp, types.intp, out, types.intp), codegen


@njit(cache=True, nogil=True)
def _decode(words, out):
    """Votes (D, S, S, L) of words of codes (D, S, W, L)."""
    depth, side, count, lanes = words.shape
    codes, votes = words.reshape(words.size), out.reshape(out.size)
    for row in range(depth * side):
        for x in range(side):
            at, to = (row * count + x // 4) * lanes, (row * side + x) * lanes
            for k in range(0, lanes, WIDTH):
                _votes(codes, at + k, x % 4, votes, to + k)


@njit(cache=True, nogil=True)
def patches(start, stop, codes, size, rows, columns, centres, strides, out):
    """Fills `out` with the votes around pixels, many pixels side by side.

    Arrays:
        start, stop: the blocks to fill here, of B.
        codes: (C, ...) uint8, of each camera N x H x W in order, and `SPARE` that nobody asks for.
        size: N, H, W.
        rows, columns: (M,) int64, the pixels; all their neighbours must be in the image.
        centres: (M,) int64, the plane in the middle of each patch.
        strides: (M,) int64, planes from one sample of the patch to the next.
        out: (C, B, D, S, S, L) float32; pixel m is lane m % L of block m // L. Planes that there
            are not have no votes.
    """
    depth, side, _, lanes = out.shape[2:]
    for b in range(start, stop):
        first = b * lanes
        words = np.zeros((depth, side, -(-side // 4), lanes), np.uint32)
        for c in range(len(codes)):
            for m in range(first, min(first + lanes, len(rows))):
                pixel = rows[m], columns[m], centres[m], strides[m]
                _gather(codes[c], size, pixel, m - first, words)
            _decode(words, out[c, b])
