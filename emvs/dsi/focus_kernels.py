"""The compiled loops of the variance of votes around each pixel, folded into its first maximum."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg, var-annotated"

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.dsi.fusion_kernels import fold_row
from eventsweep.emvs.utils.vectors_kernels import WIDTH, larger, load, plus, splat, store

BLOCK = 16
"""Rows whose votes of one plane, and whose state, stay in a core's second cache."""
PAIR = 2 * WIDTH
"""Columns that are summed at a time: scratch is filled up to a multiple of them."""
_TILE = 8 * PAIR  # columns whose votes of a block's windows stay in its first
_ZERO = np.float32(0)


@njit(cache=True, nogil=True)
def _take(plane, top, row_of, rows, filled):
    """Copies rows of a plane, mirrored at its rim, one after another: so memory is fastest."""
    width = plane.shape[1]
    for y in range(rows):
        row, copy = plane[row_of[top + y]], filled[y]
        for x in range(width):
            copy[x] = row[x]


@njit(cache=True, nogil=True)
def _down(votes, at, step, weight, means, squares, to):
    """Weighted sums of the votes, and of their squares, down the columns of two vectors.

    votes (N,), the middle at number `at`, rows `step` apart; weight (r + 1,); to the scratch from
    number `to` on.
    """
    a, b, w = load(votes, at), load(votes, at + WIDTH), splat(weight[0])
    mean, mean_next = w * a, w * b
    square, square_next = mean * a, mean_next * b
    for k in range(1, len(weight)):
        w, above, below = splat(weight[k]), at - k * step, at + k * step
        a, b = load(votes, above), load(votes, below)
        c, d = load(votes, above + WIDTH), load(votes, below + WIDTH)
        mean, mean_next = plus(mean, w, a + b), plus(mean_next, w, c + d)
        square = plus(square, w, plus(a * a, b, b))
        square_next = plus(square_next, w, plus(c * c, d, d))
    store(means, to, mean)
    store(means, to + WIDTH, mean_next)
    store(squares, to, square)
    store(squares, to + WIDTH, square_next)


@njit(cache=True, nogil=True)
def _rows_down(votes, step, rows, weight, means, squares):
    """Fills rows of scratch (rows, `step` + 2 r) with sums down the columns, tile by tile."""
    r = len(weight) - 1
    for left in range(0, step, _TILE):
        for y in range(rows):
            at, to = (y + r) * step, y * (step + 2 * r) + r
            for x in range(left, min(left + _TILE, step), PAIR):
                _down(votes, at + x, step, weight, means, squares, to + x)


@njit(cache=True, nogil=True)
def _mirror(sums, column_of, radius, width):
    """Fills both ends of a row of scratch."""
    for k in range(radius):
        sums[k] = sums[radius + column_of[k]]
        sums[radius + width + k] = sums[radius + column_of[radius + width + k]]


@njit(cache=True, nogil=True)
def _across(means, squares, at, weight, out, to):
    """The variance of two vectors: from weighted sums along a row."""
    w = splat(weight[0])
    mean, mean_next = w * load(means, at), w * load(means, at + WIDTH)
    square, square_next = w * load(squares, at), w * load(squares, at + WIDTH)
    for k in range(1, len(weight)):
        w, p, q = splat(weight[k]), at - k, at + k
        mean = plus(mean, w, load(means, p) + load(means, q))
        mean_next = plus(mean_next, w, load(means, p + WIDTH) + load(means, q + WIDTH))
        square = plus(square, w, load(squares, p) + load(squares, q))
        square_next = plus(square_next, w, load(squares, p + WIDTH) + load(squares, q + WIDTH))
    nothing = splat(_ZERO)
    store(out, to, larger(square - mean * mean, nothing))
    store(out, to + WIDTH, larger(square_next - mean_next * mean_next, nothing))


@njit(cache=True, nogil=True)
def fold_variance(
    start, stop, votes, step, planes, first,
    weight, row_of, column_of, taken, sums, rows, best, index, left, right, previous,
):  # fmt: skip
    """Folds the weighted local variance of planes into their first maximum and both neighbours.

    No plane of it is stored: blocks of rows are summed down the columns, then across, while their
    state stays in a core's cache for all planes of a batch.

    Arrays:
        start, stop: the strips of blocks to fold here, of S.
        votes: (N,) float32; a plane of H x W votes begins every `step` of them.
        planes: how many there are.
        first: number of the first of them.
        weight: (r + 1,) float32, half a symmetric window, the middle first.
        row_of, column_of: (H + 2 r,), (W + 2 r,) int64, indices of the image mirrored at its rim.
        taken: (S, BLOCK + 2 r, C) float32 scratch of S strips; C a multiple of `PAIR`, at least W.
        sums: (S, 2, BLOCK, C + 2 r) float32 scratch.
        rows: (S, C) float32 scratch.
        best, index, left, right, previous: (H, W), as in `emvs.dsi.fusion_kernels.fold`.
    """
    height, width = best.shape
    radius, columns = len(weight) - 1, rows.shape[1]
    blocks, strips = -(-height // BLOCK), len(rows)
    for s in range(start, stop):
        scratch, block, out = sums[s], taken[s], rows[s]
        means, squares = scratch[0].reshape(scratch[0].size), scratch[1].reshape(scratch[1].size)
        for b in range(s * blocks // strips, (s + 1) * blocks // strips):
            top = b * BLOCK
            count = min(BLOCK, height - top)
            for k in range(planes):
                plane = votes[k * step : k * step + height * width].reshape(height, width)
                _take(plane, top, row_of, count + 2 * radius, block)
                _rows_down(block.reshape(block.size), columns, count, weight, means, squares)
                for y in range(count):
                    _mirror(scratch[0, y], column_of, radius, width)
                    _mirror(scratch[1, y], column_of, radius, width)
                    for x in range(0, columns, PAIR):
                        at = y * (columns + 2 * radius) + radius + x
                        _across(means, squares, at, weight, out, x)
                    r = top + y
                    fold_row(
                        first + k, out[:width], best[r], index[r], left[r], right[r], previous[r],
                    )  # fmt: skip
