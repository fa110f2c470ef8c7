"""The compiled loops after the votes: fuse rows of volumes, fold planes into their maximum."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

# `emvs.dsi.fusion.MEANS` has their names.
CODES = range(7)
MIN, HARMONIC, GEOMETRIC, ARITHMETIC, RMS, MAX, HARMONIC_EPS = CODES
CAMERA = 100  # CAMERA + c: camera c alone

# As an index: for a literal, numba would compile what is called once more.
_FIRST = np.int64(0)
_ZERO, _ONE, _TWO, _EPS = np.float32(0), np.float32(1), np.float32(2), np.float32(0.1)

# In all of these: votes (V, P, cells) float32, a volume for each camera, sub-interval and polarity;
# `which` the volumes to fuse, `p` the plane, `lo` the row's first cell, and `out` one row of the
# image, filled. One pass per volume over a row that stays in L1 vectorises; one pass per pixel over
# the volumes does not.


@njit(cache=True, nogil=True)
def _copy(votes, volume, p, lo, out):
    row = votes[volume, p, lo : lo + len(out)]
    for x in range(len(out)):
        out[x] = row[x]


@njit(cache=True, nogil=True)
def _minimum(votes, which, p, lo, out):
    _copy(votes, which[0], p, lo, out)
    for c in range(1, len(which)):
        row = votes[which[c], p, lo : lo + len(out)]
        for x in range(len(out)):
            new, old = row[x], out[x]
            out[x] = new if new < old else old


@njit(cache=True, nogil=True)
def _maximum(votes, which, p, lo, out):
    _copy(votes, which[0], p, lo, out)
    for c in range(1, len(which)):
        row = votes[which[c], p, lo : lo + len(out)]
        for x in range(len(out)):
            new, old = row[x], out[x]
            out[x] = new if new > old else old


@njit(cache=True, nogil=True, error_model="numpy")
def _harmonic(votes, which, p, lo, out):
    """N / Σ(1/x): a zero gives 1/0 = inf, and N/inf = 0."""
    if len(which) == 2:
        _harmonic_of_two(votes, which, p, lo, out)
        return
    count = np.float32(len(which))
    out[:] = _ZERO
    for c in range(len(which)):
        row = votes[which[c], p, lo : lo + len(out)]
        for x in range(len(out)):
            out[x] += _ONE / row[x]
    for x in range(len(out)):
        out[x] = count / out[x]


@njit(cache=True, nogil=True, error_model="numpy")
def _harmonic_of_two(votes, which, p, lo, out):
    """2ab / (a + b), 0 where both are 0: one division, where the general form needs three."""
    left, right = votes[which[0], p, lo : lo + len(out)], votes[which[1], p, lo : lo + len(out)]
    for x in range(len(out)):
        a, b = left[x], right[x]
        both = a + b
        out[x] = _TWO * a * b / (both if both > _ZERO else _ONE)


@njit(cache=True, nogil=True)
def _geometric(votes, which, p, lo, out):
    """(Πx)^(1/N), as a square root where that is all it takes."""
    count = len(which)
    _copy(votes, which[0], p, lo, out)
    for c in range(1, count):
        row = votes[which[c], p, lo : lo + len(out)]
        for x in range(len(out)):
            out[x] *= row[x]
    if count == 2:
        for x in range(len(out)):
            out[x] = np.sqrt(out[x])
    else:
        root = _ONE / np.float32(count)
        for x in range(len(out)):
            out[x] = out[x] ** root


@njit(cache=True, nogil=True)
def _arithmetic(votes, which, p, lo, out):
    share = _ONE / np.float32(len(which))
    out[:] = _ZERO
    for c in range(len(which)):
        row = votes[which[c], p, lo : lo + len(out)]
        for x in range(len(out)):
            out[x] += row[x]
    for x in range(len(out)):
        out[x] *= share


@njit(cache=True, nogil=True)
def _root_mean_square(votes, which, p, lo, out):
    share = _ONE / np.float32(len(which))
    out[:] = _ZERO
    for c in range(len(which)):
        row = votes[which[c], p, lo : lo + len(out)]
        for x in range(len(out)):
            out[x] += row[x] * row[x]
    for x in range(len(out)):
        out[x] = np.sqrt(out[x] * share)


@njit(cache=True, nogil=True)
def _harmonic_eps(votes, which, p, lo, out):
    """2ab / (a + b + 0.1): the authors' implementation, two cameras only."""
    left, right = votes[which[0], p, lo : lo + len(out)], votes[which[1], p, lo : lo + len(out)]
    for x in range(len(out)):
        out[x] = _TWO * left[x] * right[x] / (left[x] + right[x] + _EPS)


@njit(cache=True, nogil=True)
def _mean_row(code, votes, which, p, lo, out):
    """One row by the function of a code; numba cannot call through a table of functions."""
    if code == MIN:
        _minimum(votes, which, p, lo, out)
    elif code == HARMONIC:
        _harmonic(votes, which, p, lo, out)
    elif code == GEOMETRIC:
        _geometric(votes, which, p, lo, out)
    elif code == ARITHMETIC:
        _arithmetic(votes, which, p, lo, out)
    elif code == RMS:
        _root_mean_square(votes, which, p, lo, out)
    elif code == MAX:
        _maximum(votes, which, p, lo, out)
    elif code == HARMONIC_EPS:
        _harmonic_eps(votes, which, p, lo, out)
    else:  # `emvs.dsi.fusion.Fusion` refuses such a code: should one come here, all is unknown
        out[:] = np.nan


@njit(cache=True, nogil=True)
def _fuse_row(code, votes, which, p, lo, out):
    if code >= CAMERA:
        _copy(votes, which[code - CAMERA], p, lo, out)
    elif len(which) == 1:  # any mean of a single value is that value, to the bit
        _copy(votes, which[0], p, lo, out)
    else:
        _mean_row(code, votes, which, p, lo, out)


@njit(cache=True, nogil=True)
def _fuse_levels(method, codes, sizes, which, every, votes, p, lo, level, spare, out):
    """One row of one method: inner fusion per group, outer fusion of the groups, sum of parts."""
    groups, members = sizes[method, 0], sizes[method, 1]
    for part in range(which.shape[1]):
        row = out if part == 0 else spare
        if groups == 1:
            _fuse_row(codes[method, 0], votes, which[method, part, 0, :members], p, lo, row)
        else:
            for g in range(groups):
                members_of = which[method, part, g, :members]
                _fuse_row(codes[method, 0], votes, members_of, p, lo, level[g, 0])
            _fuse_row(codes[method, 1], level, every[:groups], _FIRST, _FIRST, row)
        if part > 0:
            for x in range(len(out)):
                out[x] += row[x]


@njit(cache=True, nogil=True)
def fuse(start, stop, codes, sizes, which, every, votes, level, spare, out):
    """Fuses planes by one method, the first of the tables; a thread owns a strip of rows.

    Arrays:
        start, stop: the strips to fuse here, of S.
        codes, sizes, which, every: as in `fold`.
        votes: (V, P, cells) float32.
        level: (S, G, 1, W) float32 scratch.
        spare: (S, W) float32 scratch.
        out: (P, H, W) float32, filled.
    """
    planes, height, width = out.shape
    strips = len(level)
    for s in range(start, stop):
        for y in range(s * height // strips, (s + 1) * height // strips):
            for p in range(planes):
                _fuse_levels(
                    _FIRST, codes, sizes, which, every, votes, p, y * width, level[s], spare[s],
                    out[p, y],
                )  # fmt: skip


@njit(cache=True, nogil=True)
def fold_row(plane, fused, best, index, left, right, previous):
    """Running first maximum of one row, with the values before and after it."""
    before, now = index.dtype.type(plane - 1), index.dtype.type(plane)
    for x in range(len(fused)):
        # Everything is loaded before anything is chosen: only then does the loop vectorise (2.5x).
        value, last, top, where = fused[x], previous[x], best[x], index[x]
        lower, upper = left[x], right[x]
        right[x] = value if where == before else upper
        left[x] = last if value > top else lower
        index[x] = now if value > top else where
        best[x] = value if value > top else top
        previous[x] = value


@njit(cache=True, nogil=True)
def fold(
    start, stop, codes, sizes, which, every, votes, first, planes, level, spare, fused, replaces,
    best, index, left, right, previous,
):  # fmt: skip
    """Folds a batch of planes into every method's running maximum; a thread owns a strip of rows.

    The fused row lives in L1 only, and the state of a row is read once per batch.

    Arrays:
        start, stop: the strips to fold here, of S.
        codes: (M, 2) int64, per method the fusion within a group, and that of the groups.
        sizes: (M, 2) int64, per method how many groups, and how many volumes in each.
        which: (M, L, G, K) int64, the volumes of each group; L fused parts are summed.
        every: (G,) int64, 0, 1, 2, ...
        votes: (V, P, cells) float32.
        first: index of the batch's first plane.
        planes: how many of the P planes count.
        level: (S, G, 1, W) float32 scratch, the fused groups; S strips.
        spare, fused: (S, W) float32 scratch.
        replaces: whether the last method's fused planes replace those of the first volume.
        best, left, right, previous: (M, H, W) float32, updated. `best` begins at -1.
        index: (M, H, W) int16 or int32, updated. Begins at -2.
    """
    height, width = best.shape[1:]
    strips = len(level)
    for s in range(start, stop):
        for y in range(s * height // strips, (s + 1) * height // strips):
            for m in range(len(codes)):
                for p in range(planes):
                    _fuse_levels(
                        m, codes, sizes, which, every, votes, p, y * width, level[s], spare[s],
                        fused[s],
                    )  # fmt: skip
                    fold_row(
                        first + p, fused[s], best[m, y], index[m, y], left[m, y], right[m, y],
                        previous[m, y],
                    )  # fmt: skip
                    if replaces and m == len(codes) - 1:
                        votes[0, p, y * width : (y + 1) * width] = fused[s]
