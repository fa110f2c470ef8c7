"""The compiled loops of the variance of votes around each pixel, folded into its first maximum."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg, var-annotated"

import numpy as np
from numba import get_thread_id, njit, prange  # type: ignore[attr-defined]

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from emvs.dsi.fusion_kernels import fold_row
from emvs.utils.vectors_kernels import WIDTH, larger, load, plus, splat, store

BLOCK = 16
"""Rows whose state, and votes of one plane, stay in a core's second cache."""
LEAST = 2 * WIDTH
"""Columns an image must have."""
_TILE = 8 * LEAST  # columns whose votes of a block's windows stay in its first
_ZERO = np.float32(0)


@njit(cache=True)
def _down(votes, at, above, below, weight, means, squares, to):
    """Weighted sums of the votes, and of their squares, down the columns of two vectors.

    votes (N,), the middle at number `at`; above, below (r,) int64, how far from it the rows are;
    weight (r + 1,); to the scratch from number `to` on.
    """
    a, b, w = load(votes, at), load(votes, at + WIDTH), splat(weight[0])
    mean, mean_next = w * a, w * b
    square, square_next = mean * a, mean_next * b
    for k in range(len(above)):
        w = splat(weight[k + 1])
        a, b = load(votes, at + above[k]), load(votes, at + below[k])
        c, d = load(votes, at + above[k] + WIDTH), load(votes, at + below[k] + WIDTH)
        mean, mean_next = plus(mean, w, a + b), plus(mean_next, w, c + d)
        square, square_next = (
            plus(square, w, plus(a * a, b, b)),
            plus(square_next, w, plus(c * c, d, d)),
        )
    store(means, to, mean)
    store(means, to + WIDTH, mean_next)
    store(squares, to, square)
    store(squares, to + WIDTH, square_next)


@njit(cache=True)
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


@njit(cache=True)
def _mirror(padded, column_of, radius, width):
    for k in range(radius):
        padded[k] = padded[radius + column_of[k]]
        padded[radius + width + k] = padded[radius + column_of[radius + width + k]]


@njit(cache=True)
def _rows_down(votes, width, top, rows, above, below, weight, means, squares):
    """Fills rows of scratch (rows, W + 2 r) with sums down the columns, tile by tile."""
    r = len(weight) - 1
    for left in range(0, width, _TILE):
        for y in range(rows):
            at, to = (top + y) * width, y * (width + 2 * r) + r
            up, down = above[top + y], below[top + y]
            for x in range(left, min(left + _TILE, width), LEAST):
                x = min(x, width - LEAST)  # the last ones overlap: none goes over the end
                _down(votes, at + x, up, down, weight, means, squares, to + x)


@njit(cache=True)
def _row_across(means, squares, first, weight, out):
    """Fills `out` with the variance of one row, whose sums begin at number `first`."""
    for x in range(0, len(out), LEAST):
        x = min(x, len(out) - LEAST)
        _across(means, squares, first + x, weight, out, x)


@njit(parallel=True, cache=True)
def fold_variance(
    votes, step, planes, first,
    weight, above, below, column_of, padded, rows, best, index, left, right, previous,
):  # fmt: skip
    """Folds the weighted local variance of planes into their first maximum and both neighbours.

    No plane of it is stored: blocks of rows are summed down the columns, then across, while their
    state stays in a core's cache for all planes of a batch.

    Arrays:
        votes: (N,) float32; a plane of H x W votes begins every `step` of them.
        planes: how many there are.
        first: number of the first of them.
        weight: (r + 1,) float32, half a symmetric window, the middle first.
        above, below: (H, r) int64, how many votes from a row to the first, second, ... one before
            it and behind it, of the image mirrored at its rim.
        column_of: (W + 2 r,) int64, columns of the image mirrored at its rim; W at least `LEAST`.
        padded: (T, 2, BLOCK, W + 2 r) float32 scratch of T threads.
        rows: (T, W) float32 scratch.
        best, index, left, right, previous: (H, W), as in `emvs.dsi.fusion_kernels.fold`.
    """
    height, width = best.shape
    radius, blocks = len(weight) - 1, -(-height // BLOCK)
    long = width + 2 * radius
    for b in prange(blocks):
        thread, top = get_thread_id(), b * BLOCK
        scratch, out = padded[thread], rows[thread]
        means, squares = scratch[0].reshape(BLOCK * long), scratch[1].reshape(BLOCK * long)
        count = min(BLOCK, height - top)
        for k in range(planes):
            plane = votes[k * step : k * step + height * width]
            _rows_down(plane, width, top, count, above, below, weight, means, squares)
            for y in range(count):
                _mirror(scratch[0, y], column_of, radius, width)
                _mirror(scratch[1, y], column_of, radius, width)
                _row_across(means, squares, y * long + radius, weight, out)
                r = top + y
                fold_row(first + k, out, best[r], index[r], left[r], right[r], previous[r])
