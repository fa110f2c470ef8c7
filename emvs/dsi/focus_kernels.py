"""The compiled loops of the extraction by focus. Arrays in, state filled, nothing else."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

import numpy as np
from numba import njit, prange

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from emvs.dsi.fusion_kernels import fold_row

TAPS = 5
"""How many weights to either side are taken at once; windows are filled up with weights of 0."""
_BLOCK = 8  # rows whose votes of one plane, and whose state of all planes, fit a core's cache
_ZERO = np.float32(0)


@njit(cache=True)
def _down(plane, y, row_of, weight, mean, square):
    """Weighted column sums of the votes and of their squares around row y."""
    middle, w, at = plane[y], weight[0], y + len(weight) - 1
    for x in range(len(middle)):
        mean[x] = w * middle[x]
        square[x] = w * middle[x] * middle[x]
    for k in range(1, len(weight), TAPS):
        before, behind = row_of[at - k - 4 : at - k + 1], row_of[at + k : at + k + 5]
        _add_rows(plane, before, behind, weight[k : k + 5], mean, square)


@njit(cache=True)
def _add_rows(plane, before, behind, weight, mean, square):
    """Adds five rows to either side: both sums stay in registers meanwhile."""
    a1, a2, a3, a4, a5 = before[4], before[3], before[2], before[1], before[0]
    b1, b2, b3, b4, b5 = behind[0], behind[1], behind[2], behind[3], behind[4]
    w1, w2, w3, w4, w5 = weight[0], weight[1], weight[2], weight[3], weight[4]
    for x in range(len(mean)):
        p, q, r, s, t = plane[a1, x], plane[a2, x], plane[a3, x], plane[a4, x], plane[a5, x]
        u, v, f, g, h = plane[b1, x], plane[b2, x], plane[b3, x], plane[b4, x], plane[b5, x]
        mean[x] += w1 * (p + u) + w2 * (q + v) + w3 * (r + f) + w4 * (s + g) + w5 * (t + h)
        near = w1 * (p * p + u * u) + w2 * (q * q + v * v) + w3 * (r * r + f * f)
        square[x] += near + (w4 * (s * s + g * g) + w5 * (t * t + h * h))


@njit(cache=True)
def _across(padded, column_of, weight, out):
    """Weighted sums along one row, whose ends are mirrored here first."""
    radius, width = len(weight) - 1, len(out)
    for k in range(radius):
        padded[k] = padded[radius + column_of[k]]
        padded[radius + width + k] = padded[radius + column_of[radius + width + k]]
    middle, w = padded[radius : radius + width], weight[0]
    for x in range(width):
        out[x] = w * middle[x]
    for k in range(1, len(weight), TAPS):
        _add_columns(padded[radius - k - 4 :], padded[radius + k :], weight[k : k + 5], out)


@njit(cache=True)
def _add_columns(before, behind, weight, out):
    """Adds five values to either side of each."""
    a1, a2, a3, a4, a5 = before[4:], before[3:], before[2:], before[1:], before
    b1, b2, b3, b4, b5 = behind, behind[1:], behind[2:], behind[3:], behind[4:]
    w1, w2, w3, w4, w5 = weight[0], weight[1], weight[2], weight[3], weight[4]
    for x in range(len(out)):
        near = w1 * (a1[x] + b1[x]) + w2 * (a2[x] + b2[x]) + w3 * (a3[x] + b3[x])
        out[x] += near + (w4 * (a4[x] + b4[x]) + w5 * (a5[x] + b5[x]))


@njit(parallel=True, cache=True)
def fold_variance(
    votes, step, planes, first,
    weight, row_of, column_of, padded, rows, best, index, left, right, previous,
):  # fmt: skip
    """Folds the weighted local variance of planes into their first maximum and both neighbours.

    No plane of it is stored, and the state of a row is read once per batch of planes.

    Arrays:
        votes: (N,) float32; a plane of H x W votes begins every `step` of them. A plane cut from
            contiguous votes is known to be contiguous, and only then do the loops vectorise.
        planes: how many there are.
        first: number of the first of them.
        weight: (r + 1,) float32, half a symmetric window, the middle first; r a multiple of `TAPS`.
        row_of, column_of: (H + 2 r,), (W + 2 r,) int64, indices of the image mirrored at its rim.
        padded: (S, 2, W + 2 r) float32 scratch; S strips of rows.
        rows: (S, 2, W) float32 scratch.
        best, index, left, right, previous: (H, W), as in `emvs.dsi.fusion_kernels.fold`.
    """
    height, width = best.shape
    strips, radius = len(padded), len(weight) - 1
    for s in prange(strips):
        mean, square = rows[s, 0], rows[s, 1]
        # Cut from one row each: only so numba knows that they are contiguous.
        means = padded[s, 0][radius : radius + width]
        squares = padded[s, 1][radius : radius + width]
        bottom = (s + 1) * height // strips
        for top in range(s * height // strips, bottom, _BLOCK):
            for k in range(planes):
                plane = votes[k * step : k * step + height * width].reshape(height, width)
                for y in range(top, min(top + _BLOCK, bottom)):
                    _down(plane, y, row_of, weight, means, squares)
                    _across(padded[s, 0], column_of, weight, mean)
                    _across(padded[s, 1], column_of, weight, square)
                    for x in range(width):
                        spread = square[x] - mean[x] * mean[x]
                        square[x] = spread if spread > _ZERO else _ZERO
                    fold_row(first + k, square, best[y], index[y], left[y], right[y], previous[y])


@njit(cache=True)
def _listed(disparity, candidate):
    """The candidates row by row: how many come before each pixel, their columns and disparities.

    Those in columns a to b, exclusive, of row y are numbers `before[y, a]` to `before[y, b]`: a
    window is walked without a look at pixels that are none, which are most.
    """
    height, width = candidate.shape
    before = np.empty((height, width + 1), np.int64)
    count = 0
    for y in range(height):
        for x in range(width):
            before[y, x] = count
            count += candidate[y, x]
        before[y, width] = count
    column, value = np.empty(count, np.int64), np.empty(count, np.float32)
    for y in range(height):
        for x in range(width):
            if candidate[y, x]:
                column[before[y, x]] = x
                value[before[y, x]] = disparity[y, x]
    return before, column, value


@njit(parallel=True, cache=True)
def support(disparity, candidate, radius, tolerance, out):
    """Fills `out`, at candidates, with the share of those around that have the same disparity.

    disparity (H, W) float32; candidate (H, W) bool; the same is less than `tolerance` apart. The
    middle itself does not count; alone it has support 0.
    """
    height, width = disparity.shape
    before, column, value = _listed(disparity, candidate)
    for y in prange(height):
        for m in range(before[y, 0], before[y, width]):
            x, own = column[m], value[m]
            lo, hi = max(x - radius, 0), min(x + radius + 1, width)
            agree, there = 0, 0
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                there += before[v, hi] - before[v, lo]
                for k in range(before[v, lo], before[v, hi]):
                    agree += abs(value[k] - own) < tolerance
            out[y, x] = np.float32((agree - 1) / (there - 1)) if there > 1 else _ZERO


@njit(parallel=True, cache=True)
def own_surface(disparity, candidate, radius, tolerance, towards):
    """Fills `towards` (2, H, W), at candidates, with where their own surface lies: x and y, px.

    It is the mean, over the candidates around, of the way to those of the same disparity less the
    way to those that are farther: what is nearer says nothing. Arrays as in `support`.
    """
    height, width = disparity.shape
    before, column, value = _listed(disparity, candidate)
    for y in prange(height):
        for m in range(before[y, 0], before[y, width]):
            x = column[m]
            lo, hi = max(x - radius, 0), min(x + radius + 1, width)
            nearest, farthest = value[m] + tolerance, value[m] - tolerance
            across, down, there = 0, 0, 0
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                there += before[v, hi] - before[v, lo]
                signs = 0
                for k in range(before[v, lo], before[v, hi]):
                    sign = (value[k] < nearest) - 2 * (value[k] <= farthest)
                    across += sign * (column[k] - x)
                    signs += sign
                down += signs * (v - y)
            towards[0, y, x] = np.float32(across / there)
            towards[1, y, x] = np.float32(down / there)


@njit(parallel=True, cache=True)
def fit_surface(disparity, candidate, weight, tolerance, ridge, out):
    """Fills `out`, at candidates, with the plane through the disparities around, at the middle.

    Least squares over the candidates in a square whose disparity is less than `tolerance` from
    that of the middle. Slopes that they do not determine, such as across a line, are 0.

    disparity, out (H, W) float32; candidate (H, W) bool; weight (r + 1,) float32, half a symmetric
    window, the middle first; ridge: pixels squared, added to the spread of the pixels in x and y.
    """
    height, width = disparity.shape
    radius = len(weight) - 1
    before, column, value = _listed(disparity, candidate)
    for y in prange(height):
        for m in range(before[y, 0], before[y, width]):
            x, own = column[m], float(value[m])
            lo, hi = max(x - radius, 0), min(x + radius + 1, width)
            total, sx, sy, sd = 0.0, 0.0, 0.0, 0.0
            sxx, sxy, syy, sxd, syd = 0.0, 0.0, 0.0, 0.0, 0.0
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for k in range(before[v, lo], before[v, hi]):
                    apart = float(value[k]) - own
                    if abs(apart) < tolerance:
                        i, j = column[k] - x, v - y
                        w = float(weight[abs(i)]) * float(weight[abs(j)])
                        total += w
                        sx += w * i
                        sy += w * j
                        sd += w * apart
                        sxx += w * i * i
                        sxy += w * i * j
                        syy += w * j * j
                        sxd += w * i * apart
                        syd += w * j * apart
            mx, my, md = sx / total, sy / total, sd / total
            xx, yy = sxx / total - mx * mx + ridge, syy / total - my * my + ridge
            xy = sxy / total - mx * my
            xd, yd = sxd / total - mx * md, syd / total - my * md
            det = xx * yy - xy * xy
            slope_x, slope_y = (xd * yy - yd * xy) / det, (yd * xx - xd * xy) / det
            out[y, x] = disparity[y, x] + np.float32(md - slope_x * mx - slope_y * my)
