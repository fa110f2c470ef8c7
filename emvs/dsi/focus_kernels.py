"""The compiled loops of the extraction by focus. Arrays in, state filled, nothing else."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

import numpy as np
from numba import njit, prange

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from emvs.dsi.fusion_kernels import fold_row

_ZERO = np.float32(0)


@njit(cache=True)
def _down(plane, y, row_of, weight, mean, square):
    """Weighted column sums of the votes and of their squares around row y; the ends stay free."""
    radius = len(weight) - 1
    middle, w = plane[y], weight[0]
    for x in range(len(middle)):
        mean[radius + x] = w * middle[x]
        square[radius + x] = w * middle[x] * middle[x]
    for k in range(1, len(weight)):
        above, below, w = plane[row_of[y + radius - k]], plane[row_of[y + radius + k]], weight[k]
        for x in range(len(middle)):
            mean[radius + x] += w * (above[x] + below[x])
            square[radius + x] += w * (above[x] * above[x] + below[x] * below[x])


@njit(cache=True)
def _across(padded, column_of, weight, out):
    """Weighted sums along one row, whose ends are mirrored here first."""
    radius, width = len(weight) - 1, len(out)
    for k in range(radius):
        padded[k] = padded[radius + column_of[k]]
        padded[radius + width + k] = padded[radius + column_of[radius + width + k]]
    w = weight[0]
    for x in range(width):
        out[x] = w * padded[radius + x]
    for k in range(1, len(weight)):
        left, right, w = padded[radius - k :], padded[radius + k :], weight[k]
        for x in range(width):
            out[x] += w * (left[x] + right[x])


@njit(parallel=True, cache=True)
def fold_variance(
    value, plane, weight, row_of, column_of, padded, rows, best, index, left, right, previous
):
    """Folds the weighted local variance of a plane into its first maximum and both neighbours.

    No plane of it is stored.

    Arrays:
        value: (H, W) float32 votes.
        plane: its number.
        weight: (r + 1,) float32, half a symmetric window, the middle first.
        row_of, column_of: (H + 2 r,), (W + 2 r,) int64, indices of the image mirrored at its rim.
        padded: (S, 2, W + 2 r) float32 scratch; S strips of rows.
        rows: (S, 2, W) float32 scratch.
        best, index, left, right, previous: (H, W), as in `emvs.dsi.fusion_kernels.fold`.
    """
    height, strips = len(value), len(padded)
    for s in prange(strips):
        mean, square = rows[s, 0], rows[s, 1]
        for y in range(s * height // strips, (s + 1) * height // strips):
            _down(value, y, row_of, weight, padded[s, 0], padded[s, 1])
            _across(padded[s, 0], column_of, weight, mean)
            _across(padded[s, 1], column_of, weight, square)
            for x in range(len(mean)):
                spread = square[x] - mean[x] * mean[x]
                square[x] = spread if spread > _ZERO else _ZERO
            fold_row(plane, square, best[y], index[y], left[y], right[y], previous[y])


@njit(parallel=True, cache=True)
def support(disparity, candidate, radius, tolerance, out):
    """Fills `out`, at candidates, with the share of those around that have the same disparity.

    disparity (H, W) float32; candidate (H, W) bool; the same is less than `tolerance` apart. The
    middle itself does not count; alone it has support 0.
    """
    height, width = disparity.shape
    for y in prange(height):
        for x in range(width):
            if not candidate[y, x]:
                continue
            agree, there = 0, 0
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    if candidate[v, u]:
                        there += 1
                        agree += abs(disparity[v, u] - disparity[y, x]) < tolerance
            out[y, x] = np.float32((agree - 1) / (there - 1)) if there > 1 else _ZERO


@njit(parallel=True, cache=True)
def own_surface(disparity, candidate, radius, tolerance, towards):
    """Fills `towards` (2, H, W), at candidates, with where their own surface lies: x and y, px.

    It is the mean, over the candidates around, of the way to those of the same disparity less the
    way to those that are farther: what is nearer says nothing. Arrays as in `support`.
    """
    height, width = disparity.shape
    for y in prange(height):
        for x in range(width):
            if not candidate[y, x]:
                continue
            across, down, there = 0, 0, 0
            nearest, farthest = disparity[y, x] + tolerance, disparity[y, x] - tolerance
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    if candidate[v, u]:
                        there += 1
                        sign = (disparity[v, u] < nearest) - 2 * (disparity[v, u] <= farthest)
                        across += sign * (u - x)
                        down += sign * (v - y)
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
    for y in prange(height):
        for x in range(width):
            if not candidate[y, x]:
                continue
            total, sx, sy, sd = 0.0, 0.0, 0.0, 0.0
            sxx, sxy, syy, sxd, syd = 0.0, 0.0, 0.0, 0.0, 0.0
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    apart = float(disparity[v, u]) - float(disparity[y, x])
                    if candidate[v, u] and abs(apart) < tolerance:
                        i, j = u - x, v - y
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
