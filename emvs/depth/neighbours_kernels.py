"""The compiled loops over neighbours: a masked median; support and surface of each candidate."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

_ZERO = np.float32(0)


@njit(cache=True, nogil=True)
def listed(disparity, candidate):
    """The candidates row by row: how many come before each pixel, their columns and disparities.

    Those in columns a to b, exclusive, of row y are numbers `before[y, a]` to `before[y, b]`: a
    window is walked without a look at pixels that are none, which are most.

    disparity (H, W) float32; candidate (H, W) bool.
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


@njit(cache=True, nogil=True)
def support(start, stop, before, column, value, radius, tolerance, out):
    """Fills `out`, at candidates, with the share of those around that have the same disparity.

    start, stop: the rows to fill here; before, column, value: as `listed` gives them; the same is
    less than `tolerance` apart. The middle itself does not count; alone it has support 0.
    """
    height, width = out.shape
    for y in range(start, stop):
        for m in range(before[y, 0], before[y, width]):
            x, own = column[m], value[m]
            lo, hi = max(x - radius, 0), min(x + radius + 1, width)
            agree, there = 0, 0
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                there += before[v, hi] - before[v, lo]
                for k in range(before[v, lo], before[v, hi]):
                    agree += abs(value[k] - own) < tolerance
            out[y, x] = np.float32((agree - 1) / (there - 1)) if there > 1 else _ZERO


@njit(cache=True, nogil=True)
def own_surface(start, stop, before, column, value, radius, tolerance, towards):
    """Fills `towards` (2, H, W), at candidates, with where their own surface lies: x and y, px.

    It is the mean, over the candidates around, of the way to those of the same disparity less the
    way to those that are farther: what is nearer says nothing. Arrays as in `support`.
    """
    height, width = towards.shape[1:]
    for y in range(start, stop):
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


@njit(cache=True, nogil=True)
def fit_surface(start, stop, before, column, value, weight, tolerance, ridge, out):
    """Fills `out`, at candidates, with the plane through the disparities around, at the middle.

    Least squares over the candidates in a square whose disparity is less than `tolerance` from
    that of the middle. Slopes that they do not determine, such as across a line, are 0.

    out (H, W) float32; weight (r + 1,) float32, half a symmetric window, the middle first; ridge:
    pixels squared, added to the spread of the pixels in x and y. Other arrays as in `support`.
    """
    height, width = out.shape
    radius = len(weight) - 1
    for y in range(start, stop):
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
            out[y, x] = value[m] + np.float32(md - slope_x * mx - slope_y * my)


@njit(cache=True, nogil=True)
def _lower_median(values, count):
    """The (count - 1) // 2-th smallest of the first `count` values, by quickselect in place."""
    want, lo, hi = (count - 1) // 2, 0, count - 1
    while lo < hi:
        pivot, i, j = values[(lo + hi) // 2], lo, hi
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if want <= j:
            hi = j
        elif want >= i:
            lo = i
        else:
            break
    return values[want]


@njit(cache=True, nogil=True)
def masked_median(start, stop, values, mask, radius, patch, out):
    """Fills rows `start` to `stop` of `out`, at mask pixels.

    Row y uses `patch[y]`, (2 radius + 1)² + 1 values, as scratch.
    """
    height, width = values.shape
    for y in range(start, stop):
        row, top, bottom = patch[y], max(y - radius, 0), min(y + radius + 1, height)
        for x in range(width):
            if not mask[y, x]:
                continue
            count = np.int64(0)  # a literal would be compiled for, too
            for v in range(top, bottom):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    # Without a branch: what is outside the mask is overwritten by the next.
                    row[count] = values[v, u]
                    count += mask[v, u]
            out[y, x] = _lower_median(row, count)
