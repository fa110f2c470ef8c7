"""The compiled loops after the votes: fuse the cameras' rows, fold planes into their maximum."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

import numpy as np
from numba import njit, prange

import emvs.threads  # noqa: F401  (names the threading layer before the kernels compile)

# Numba cannot call through a table of functions, so the table is of codes (`emvs.fusion`).
MIN, HARMONIC, GEOMETRIC, ARITHMETIC, RMS, MAX, HARMONIC_EPS = range(7)
CAMERA = 100  # CAMERA + c: camera c alone

_ZERO, _ONE, _TWO, _EPS = np.float32(0), np.float32(1), np.float32(2), np.float32(0.1)

# In all of these: votes (C, P, cells) float32, `p` the plane, `lo` the row's first cell, and `out`
# one row of the image, filled. One pass per camera over a row that stays in L1 vectorises; one pass
# per pixel over the cameras does not.


@njit(cache=True)
def _one_camera(votes, camera, p, lo, out):
    row = votes[camera, p, lo : lo + len(out)]
    for x in range(len(out)):
        out[x] = row[x]


@njit(cache=True)
def _minimum(votes, p, lo, out):
    _one_camera(votes, 0, p, lo, out)
    for c in range(1, votes.shape[0]):
        row = votes[c, p, lo : lo + len(out)]
        for x in range(len(out)):
            new, old = row[x], out[x]
            out[x] = new if new < old else old


@njit(cache=True)
def _maximum(votes, p, lo, out):
    _one_camera(votes, 0, p, lo, out)
    for c in range(1, votes.shape[0]):
        row = votes[c, p, lo : lo + len(out)]
        for x in range(len(out)):
            new, old = row[x], out[x]
            out[x] = new if new > old else old


@njit(cache=True, error_model="numpy")
def _harmonic(votes, p, lo, out):
    """N / Σ(1/x): a zero gives 1/0 = inf, and N/inf = 0."""
    cameras = np.float32(votes.shape[0])
    out[:] = _ZERO
    for c in range(votes.shape[0]):
        row = votes[c, p, lo : lo + len(out)]
        for x in range(len(out)):
            out[x] += _ONE / row[x]
    for x in range(len(out)):
        out[x] = cameras / out[x]


@njit(cache=True)
def _geometric(votes, p, lo, out):
    """(Πx)^(1/N), as a square root where that is all it takes."""
    cameras = votes.shape[0]
    _one_camera(votes, 0, p, lo, out)
    for c in range(1, cameras):
        row = votes[c, p, lo : lo + len(out)]
        for x in range(len(out)):
            out[x] *= row[x]
    if cameras == 2:
        for x in range(len(out)):
            out[x] = np.sqrt(out[x])
    elif cameras > 2:
        root = _ONE / np.float32(cameras)
        for x in range(len(out)):
            out[x] = out[x] ** root


@njit(cache=True)
def _arithmetic(votes, p, lo, out):
    share = _ONE / np.float32(votes.shape[0])
    out[:] = _ZERO
    for c in range(votes.shape[0]):
        row = votes[c, p, lo : lo + len(out)]
        for x in range(len(out)):
            out[x] += row[x]
    for x in range(len(out)):
        out[x] *= share


@njit(cache=True)
def _root_mean_square(votes, p, lo, out):
    share = _ONE / np.float32(votes.shape[0])
    out[:] = _ZERO
    for c in range(votes.shape[0]):
        row = votes[c, p, lo : lo + len(out)]
        for x in range(len(out)):
            out[x] += row[x] * row[x]
    for x in range(len(out)):
        out[x] = np.sqrt(out[x] * share)


@njit(cache=True)
def _harmonic_eps(votes, p, lo, out):
    """2ab / (a + b + 0.1): the authors' implementation, two cameras only."""
    one, other = votes[0, p, lo : lo + len(out)], votes[1, p, lo : lo + len(out)]
    for x in range(len(out)):
        out[x] = _TWO * one[x] * other[x] / (one[x] + other[x] + _EPS)


@njit(cache=True)
def _fuse_row(code, votes, p, lo, out):
    if code >= CAMERA:
        _one_camera(votes, code - CAMERA, p, lo, out)
    elif code == MIN:
        _minimum(votes, p, lo, out)
    elif code == HARMONIC:
        _harmonic(votes, p, lo, out)
    elif code == GEOMETRIC:
        _geometric(votes, p, lo, out)
    elif code == ARITHMETIC:
        _arithmetic(votes, p, lo, out)
    elif code == RMS:
        _root_mean_square(votes, p, lo, out)
    elif code == MAX:
        _maximum(votes, p, lo, out)
    else:
        _harmonic_eps(votes, p, lo, out)


@njit(parallel=True, cache=True)
def fuse(code, votes, out):
    """Fuses planes: votes (C, P, cells) float32 to `out` (P, H, W) float32, filled."""
    planes, height, width = out.shape
    for y in prange(height):
        for p in range(planes):
            _fuse_row(code, votes, p, y * width, out[p, y])


@njit(cache=True)
def _fold_row(plane, fused, best, index, left, right, previous):
    """Running first maximum of one row, with the values before and after it."""
    before, now = np.int16(plane - 1), np.int16(plane)
    for x in range(len(fused)):
        # Everything is loaded before anything is chosen: only then does the loop vectorise (2.5x).
        value, last, top, where = fused[x], previous[x], best[x], index[x]
        lower, upper = left[x], right[x]
        right[x] = value if where == before else upper
        left[x] = last if value > top else lower
        index[x] = now if value > top else where
        best[x] = value if value > top else top
        previous[x] = value


@njit(parallel=True, cache=True)
def fold(codes, votes, first, planes, fused, best, index, left, right, previous):
    """Folds a batch of planes into every method's running maximum; a thread owns image rows.

    The fused row lives in L1 only, and the state of a row is read once per batch.

    Arrays:
        codes: (M,) int64, one per method.
        votes: (C, P, cells) float32.
        first: index of the batch's first plane.
        planes: how many of the P planes count.
        fused: (H, W) float32 scratch.
        best, left, right, previous: (M, H, W) float32, updated. `best` begins at -1.
        index: (M, H, W) int16, updated. Begins at -2.
    """
    height, width = fused.shape
    for y in prange(height):
        for m in range(len(codes)):
            for p in range(planes):
                _fuse_row(codes[m], votes, p, y * width, fused[y])
                _fold_row(
                    first + p, fused[y], best[m, y], index[m, y], left[m, y], right[m, y],
                    previous[m, y],
                )  # fmt: skip
