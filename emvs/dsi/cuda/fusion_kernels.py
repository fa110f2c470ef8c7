"""The GPU's loops after the votes: fuse voxels, fold planes into their maximum, copy rows."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, attr-defined"

import math

import numpy as np
from numba import cuda

from eventsweep.emvs.dsi.fusion_kernels import (
    ARITHMETIC,
    CAMERA,
    GEOMETRIC,
    HARMONIC,
    HARMONIC_EPS,
    MAX,
    MIN,
    RMS,
)

_ZERO, _ONE, _TWO, _EPS = np.float32(0), np.float32(1), np.float32(2), np.float32(0.1)
_INFINITE = np.float32(np.inf)

# A fusion of n values is taken in two numbers, a sum and a product, one value after another: so
# that fusions of fusions need no memory. Both begin at what the first value makes of them.


@cuda.jit(device=True)
def _begin(code, n, x):
    if code == RMS and n > 1:
        return x * x, x
    if code == HARMONIC and n > 2:
        return (_ONE / x if x > _ZERO else _INFINITE), x
    return x, x


@cuda.jit(device=True)
def _with(code, n, total, product, x):
    if code == MIN:
        return min(total, x), product
    if code == MAX:
        return max(total, x), product
    if code == RMS:
        return total + x * x, product
    if code == HARMONIC and n > 2:
        return total + (_ONE / x if x > _ZERO else _INFINITE), product
    return total + x, product * x


@cuda.jit(device=True)
def _end(code, n, total, product):
    if n == 1:
        return total
    if code == ARITHMETIC:
        return total * (_ONE / np.float32(n))
    if code == RMS:
        return math.sqrt(total * (_ONE / np.float32(n)))
    if code == GEOMETRIC:
        return math.sqrt(product) if n == 2 else product ** (_ONE / np.float32(n))
    if code == HARMONIC_EPS:
        return _TWO * product / (total + _EPS)
    if code == HARMONIC and n == 2:
        return _TWO * product / total if total > _ZERO else _ZERO
    if code == HARMONIC:
        return np.float32(n) / total
    return total


@cuda.jit(device=True)
def _inner(code, members, which, m, part, g, votes, p, c):
    """Fuses one group of volumes in one voxel."""
    if code >= CAMERA:
        return votes[which[m, part, g, code - CAMERA], p, c]
    x = votes[which[m, part, g, 0], p, c]
    total, product = _begin(code, members, x)
    for k in range(1, members):
        x = votes[which[m, part, g, k], p, c]
        total, product = _with(code, members, total, product, x)
    return _end(code, members, total, product)


@cuda.jit(device=True)
def _fused(codes, sizes, which, m, votes, p, c):
    """One voxel of method `m`: inner fusion per group, outer fusion of groups, sum of parts."""
    groups, members = sizes[m, 0], sizes[m, 1]
    inner, outer = codes[m, 0], codes[m, 1]
    value = _ZERO
    for part in range(which.shape[1]):
        x = _inner(inner, members, which, m, part, 0, votes, p, c)
        if groups > 1:
            total, product = _begin(outer, groups, x)
            for g in range(1, groups):
                x = _inner(inner, members, which, m, part, g, votes, p, c)
                total, product = _with(outer, groups, total, product, x)
            x = _end(outer, groups, total, product)
        value += x
    return value


@cuda.jit(cache=True)
def fold(codes, sizes, which, votes, first, planes, best, index, left, right, previous):
    """Folds a batch of planes into every method's first maximum; a thread owns a pixel.

    The grid is (blocks, M). Arrays as in `emvs.dsi.fusion_kernels.fold`, images as one row of
    cells:
        codes, sizes: (M, 2) int64.
        which: (M, L, G, K) int64.
        votes: (V, P, cells) float32.
        best, left, right, previous: (M, cells) float32, updated. `best` begins at -1.
        index: (M, cells) integer, updated. Begins at -2.
    """
    c, m = cuda.grid(1), cuda.blockIdx.y
    while c < best.shape[1]:
        top, where, last = best[m, c], index[m, c], previous[m, c]
        lower, upper = left[m, c], right[m, c]
        for p in range(planes):
            value, plane = _fused(codes, sizes, which, m, votes, p, c), first + p
            if where == plane - 1:
                upper = value
            if value > top:
                lower, where, top = last, plane, value
            last = value
        best[m, c], index[m, c], previous[m, c] = top, where, last
        left[m, c], right[m, c] = lower, upper
        c += cuda.gridDim.x * cuda.blockDim.x


@cuda.jit(cache=True)
def fuse(codes, sizes, which, m, votes, planes, out):
    """Fuses planes by method `m` into `out` (P, cells) float32; a thread owns a pixel."""
    c = cuda.grid(1)
    while c < out.shape[1]:
        for p in range(planes):
            out[p, c] = _fused(codes, sizes, which, m, votes, p, c)
        c += cuda.gridDim.x * cuda.blockDim.x


@cuda.jit(cache=True)
def keep_row(votes, width, row, first, planes, rows):
    """Copies one image row of (V, P, cells) votes to planes `first` and on of (V, N, W) `rows`.

    The grid is (blocks, V).
    """
    x, volume = cuda.grid(1), cuda.blockIdx.y
    while x < width:
        for p in range(planes):
            rows[volume, first + p, x] = votes[volume, p, row * width + x]
        x += cuda.gridDim.x * cuda.blockDim.x
