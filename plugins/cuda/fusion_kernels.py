"""The GPU's loops after the votes: fuse voxels, fold planes into their maximum, copy rows."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, attr-defined"

import math

import numpy as np
from numba import cuda

from eventsweep.emvs.dsi.fusion_kernels import CAMERA

_ZERO, _ONE, _TWO, _EPS = np.float32(0), np.float32(1), np.float32(2), np.float32(0.1)
_INFINITE = np.float32(np.inf)

# A fusion of n > 1 values takes value number k = 0, 1, ... n - 1 into two numbers, a sum and a
# product, so that fusions of fusions need no memory; at k = n the sum becomes the mean.


@cuda.jit(device=True)
def _minimum(k, n, total, product, x):
    if k == 0:
        return x, x
    return (min(total, x) if k < n else total), product


@cuda.jit(device=True)
def _maximum(k, n, total, product, x):
    if k == 0:
        return x, x
    return (max(total, x) if k < n else total), product


@cuda.jit(device=True)
def _sums(k, total, product, x):
    return (x, x) if k == 0 else (total + x, product * x)


@cuda.jit(device=True)
def _harmonic(k, n, total, product, x):
    """N / Σ(1/x): a zero gives inf, and N/inf = 0; of two values 2ab / (a + b)."""
    if n == 2:
        if k < n:
            return _sums(k, total, product, x)
        return (_TWO * product / total if total > _ZERO else _ZERO), product
    if k < n:
        inverse = _ONE / x if x > _ZERO else _INFINITE
        return (inverse if k == 0 else total + inverse), product
    return np.float32(n) / total, product


@cuda.jit(device=True)
def _geometric(k, n, total, product, x):
    if k < n:
        return _sums(k, total, product, x)
    return (math.sqrt(product) if n == 2 else product ** (_ONE / np.float32(n))), product


@cuda.jit(device=True)
def _arithmetic(k, n, total, product, x):
    if k < n:
        return _sums(k, total, product, x)
    return total * (_ONE / np.float32(n)), product


@cuda.jit(device=True)
def _root_mean_square(k, n, total, product, x):
    if k < n:
        return (x * x if k == 0 else total + x * x), product
    return math.sqrt(total * (_ONE / np.float32(n))), product


@cuda.jit(device=True)
def _harmonic_eps(k, n, total, product, x):
    if k < n:
        return _sums(k, total, product, x)
    return _TWO * product / (total + _EPS), product


# code -> mean, in the order of `emvs.dsi.fusion_kernels.CODES`
MEANS = (
    _minimum, _harmonic, _geometric, _arithmetic, _root_mean_square, _maximum, _harmonic_eps,
)  # fmt: skip


@cuda.jit(device=True)
def _unknown(_code, _k, _n, _total, _product, _x):
    return np.float32(np.nan), np.float32(np.nan)


def _chosen_from(code):
    """The choice among `MEANS` from a code on: numba cannot call through a table of functions."""
    mean, following = MEANS[code], _chosen_from(code + 1) if code + 1 < len(MEANS) else _unknown

    @cuda.jit(device=True)
    def choose(wanted, k, n, total, product, x):
        if wanted == code:
            return mean(k, n, total, product, x)
        return following(wanted, k, n, total, product, x)

    return choose


_mean = _chosen_from(0)


@cuda.jit(device=True)
def _inner(code, members, which, m, part, g, votes, p, c):
    """Fuses one group of volumes in one voxel."""
    if code >= CAMERA:
        return votes[which[m, part, g, code - CAMERA], p, c]
    x = votes[which[m, part, g, 0], p, c]
    if members == 1:
        return x
    total, product = _mean(code, 0, members, _ZERO, _ZERO, x)
    for k in range(1, members):
        x = votes[which[m, part, g, k], p, c]
        total, product = _mean(code, k, members, total, product, x)
    return _mean(code, members, members, total, product, x)[0]


@cuda.jit(device=True)
def _fused(codes, sizes, which, m, votes, p, c):
    """One voxel of method `m`: inner fusion per group, outer fusion of groups, sum of parts."""
    groups, members = sizes[m, 0], sizes[m, 1]
    inner, outer = codes[m, 0], codes[m, 1]
    value = _ZERO
    for part in range(which.shape[1]):
        x = _inner(inner, members, which, m, part, 0, votes, p, c)
        if groups > 1:
            total, product = _mean(outer, 0, groups, _ZERO, _ZERO, x)
            for g in range(1, groups):
                x = _inner(inner, members, which, m, part, g, votes, p, c)
                total, product = _mean(outer, g, groups, total, product, x)
            x = _mean(outer, groups, groups, total, product, x)[0]
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
