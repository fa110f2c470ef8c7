"""The compiled loops of the network: some pixels side by side in every loop, one block a thread.

Lanes are innermost, the votes of one cell for all pixels of a block, and the ray is next: a step
along the ray is a shift by one block of lanes, so every loop runs over a long contiguous row, and
vectorises.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

import numpy as np
from numba import njit, prange

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

PAD = 4
"""Samples of nothing before and behind a ray: as far as its convolutions reach."""
FEW = 4
"""Channels that are summed side by side: what is loaded once serves all of them."""
_ZERO = np.float32(0)
_CONTRACT = {"contract"}  # a product and a sum in one instruction; the order of sums stays


@njit(cache=True)
def _by_place(shares, lanes, out):
    """Copies shares (K, D, S, S L) to out (K, S, S, (D + 2) L): a row is a ray, its ends stay."""
    channels, depth, side = shares.shape[:3]
    for c in range(channels):
        for d in range(depth):
            for y in range(side):
                row = shares[c, d, y]
                for x in range(side):
                    ray = out[c, y, x][(d + 1) * lanes : (d + 2) * lanes]
                    here = row[x * lanes : (x + 1) * lanes]
                    for k in range(lanes):
                        ray[k] = here[k]


@njit(cache=True, fastmath=_CONTRACT)
def _and_nine(total, w, v):
    upper = total + w[0] * v[0] + w[1] * v[1] + w[2] * v[2]
    centre = upper + w[3] * v[3] + w[4] * v[4] + w[5] * v[5]
    return centre + w[6] * v[6] + w[7] * v[7] + w[8] * v[8]


@njit(cache=True)
def _taps_of_nine(weight, y):
    """Weights (3, 3, 3) of row y of a window: along the ray, then across."""
    near, middle, far = weight[0, y], weight[1, y], weight[2, y]
    return (
        near[0], near[1], near[2], middle[0], middle[1], middle[2], far[0], far[1], far[2],
    )  # fmt: skip


@njit(cache=True, fastmath=_CONTRACT)
def _nine(left, middle, right, lanes, weight, y, out):
    """Adds one row of 3 x 3 x 3 windows of one channel to four channels: three rays to a ray."""
    first, second, third, fourth = out[0], out[1], out[2], out[3]
    n = len(first)
    a, b, c = left[:n], middle[:n], right[:n]
    d, e, f = left[lanes : lanes + n], middle[lanes : lanes + n], right[lanes : lanes + n]
    g, h = left[2 * lanes : 2 * lanes + n], middle[2 * lanes : 2 * lanes + n]
    i = right[2 * lanes : 2 * lanes + n]
    w0, w1 = _taps_of_nine(weight[0], y), _taps_of_nine(weight[1], y)
    w2, w3 = _taps_of_nine(weight[2], y), _taps_of_nine(weight[3], y)
    for x in range(n):
        values = (a[x], b[x], c[x], d[x], e[x], f[x], g[x], h[x], i[x])
        first[x] = _and_nine(first[x], w0, values)
        second[x] = _and_nine(second[x], w1, values)
        third[x] = _and_nine(third[x], w2, values)
        fourth[x] = _and_nine(fourth[x], w3, values)


@njit(cache=True, fastmath=_CONTRACT)
def _and_five(total, w, v):
    return total + w[0] * v[0] + w[1] * v[1] + w[2] * v[2] + w[3] * v[3] + w[4] * v[4]


@njit(cache=True)
def _taps_of_five(weight):
    return weight[0], weight[1], weight[2], weight[3], weight[4]


@njit(cache=True, fastmath=_CONTRACT)
def _five(a, b, c, d, e, weight, out):
    """Adds five rays, weighted by (4, 5), to each of four."""
    first, second, third, fourth = out[0], out[1], out[2], out[3]
    n = len(first)
    a, b, c, d, e = a[:n], b[:n], c[:n], d[:n], e[:n]
    w0, w1 = _taps_of_five(weight[0]), _taps_of_five(weight[1])
    w2, w3 = _taps_of_five(weight[2]), _taps_of_five(weight[3])
    for x in range(n):
        values = (a[x], b[x], c[x], d[x], e[x])
        first[x] = _and_five(first[x], w0, values)
        second[x] = _and_five(second[x], w1, values)
        third[x] = _and_five(third[x], w2, values)
        fourth[x] = _and_five(fourth[x], w3, values)


@njit(cache=True)
def _positive(total, out):
    for x in range(len(out)):
        value = total[x]
        out[x] = value if value > _ZERO else _ZERO


@njit(cache=True)
def _begin(bias, sums):
    for o in range(FEW):
        sums[o][:] = bias[o]


@njit(cache=True)
def _patch(shares, lanes, weight, bias, sums, out):
    """3 x 3 x 3 windows: shares (K, S, S, (D + 2) L) to out (O, S - 2, S - 2, (D + 2) L)."""
    channels, length = shares.shape[0], sums.shape[1]
    for o in range(0, out.shape[0], FEW):
        for y in range(out.shape[1]):
            for x in range(out.shape[2]):
                _begin(bias[o : o + FEW], sums)
                for c in range(channels):
                    for k in range(3):
                        rows = shares[c, y + k]
                        taps = weight[o : o + FEW, c]
                        _nine(rows[x], rows[x + 1], rows[x + 2], lanes, taps, k, sums)
                for k in range(FEW):
                    _positive(sums[k], out[o + k, y, x][lanes : lanes + length])


@njit(cache=True)
def _ray(cells, lanes, weight, bias, sums, out):
    """5 x 5 x 3 windows down to the ray: cells (O, 5, 5, (D + 2) L) to out (R, (D + 2 PAD) L)."""
    length, first = sums.shape[1], PAD * lanes
    for o in range(0, out.shape[0], FEW):
        _begin(bias[o : o + FEW], sums)
        for c in range(weight.shape[1]):
            for y in range(5):
                rows = cells[c, y]
                for k in range(3):
                    a, b, d = rows[0][k * lanes :], rows[1][k * lanes :], rows[2][k * lanes :]
                    e, f = rows[3][k * lanes :], rows[4][k * lanes :]
                    _five(a, b, d, e, f, weight[o : o + FEW, c, k, y], sums)
        for k in range(FEW):
            _positive(sums[k], out[o + k][first : first + length])


@njit(cache=True)
def _along(ray, lanes, dilation, weight, bias, sums, out):
    """Five taps along the ray, added to it: ray and out (R, (D + 2 PAD) L)."""
    length, pad, step = sums.shape[1], PAD * lanes, dilation * lanes
    first = pad - 2 * step
    for o in range(0, ray.shape[0], FEW):
        _begin(bias[o : o + FEW], sums)
        for c in range(weight.shape[1]):
            row = ray[c][first:]
            a, b, d, e = row, row[step:], row[2 * step :], row[3 * step :]
            _five(a, b, d, e, row[4 * step :], weight[o : o + FEW, c], sums)
        for k in range(FEW):
            _positive(sums[k], sums[k])
            row, total = ray[o + k][pad : pad + length], sums[k]
            added = out[o + k][pad : pad + length]
            for x in range(length):
                added[x] = row[x] + total[x]


@njit(cache=True)
def _place(ray, lanes, lane, weight, bias, peak, logits):
    """Soft maximum of one pixel's logits: its place, the best sample, the share around it."""
    depth = len(logits)
    best = 0
    for d in range(depth):
        total = bias[0]
        for c in range(weight.shape[1]):
            total += weight[0, c, 0] * ray[c, (d + PAD) * lanes + lane]
        logits[d] = total
        if total > logits[best]:
            best = d
    top = logits[best]
    every, near, place = _ZERO, _ZERO, _ZERO
    for d in range(depth):
        share = np.exp(logits[d] - top)
        every += share
        if abs(d - best) <= peak:
            near += share
            place += share * np.float32(d)
    return place / near - np.float32(depth // 2), best, near / every


@njit(cache=True)
def _errors(ray, lanes, lane, best, told, hidden, hidden_bias, error, error_bias, log_error):
    """Expected errors of one pixel from the ray at its best sample and from what is told."""
    features = hidden.shape[1] - len(told)
    for k in range(len(error_bias)):
        log_error[k] = error_bias[k]
    for h in range(len(hidden_bias)):
        total = hidden_bias[h]
        for c in range(features):
            total += hidden[h, c] * ray[c, (best + PAD) * lanes + lane]
        for c in range(len(told)):
            total += hidden[h, features + c] * told[c]
        if total > _ZERO:
            for k in range(len(error_bias)):
                log_error[k] += error[k, h] * total


@njit(parallel=True, cache=True)
def judge(
    shares, cues, patch, patch_bias, ray, ray_bias, near, near_bias, far, far_bias,
    score, score_bias, hidden, hidden_bias, error, error_bias, peak, offset, log_error,
):  # fmt: skip
    """Fills `offset` and `log_error` with what the network says of every pixel.

    Arrays:
        shares: (B, K, D, S, S L) float32.
        cues: (M, F) float32; pixel m is lane m % L of block m // L.
        patch ... error_bias: the weights, as `emvs.learned.network.Network` names them;
            convolutions have a multiple of `FEW` channels, filled up with zeros.
        peak: samples on either side of the best one that decide where the depth lies.
        offset: (M,) float32, filled: samples from the patch's middle.
        log_error: (M, 2) float32, filled.
    """
    blocks, channels, depth, side, width = shares.shape
    lanes = width // side
    for b in prange(blocks):
        places = np.zeros((channels, side, side, (depth + 2) * lanes), np.float32)
        cells = np.zeros((len(patch_bias), side - 2, side - 2, (depth + 2) * lanes), np.float32)
        rays = np.zeros((2, len(ray_bias), (depth + 2 * PAD) * lanes), np.float32)
        sums = np.empty((FEW, depth * lanes), np.float32)
        logits = np.empty(depth, np.float32)
        told = np.empty(cues.shape[1] + 2, np.float32)
        one, other = rays[0], rays[1]
        _by_place(shares[b], lanes, places)
        _patch(places, lanes, patch, patch_bias, sums, cells)
        _ray(cells, lanes, ray, ray_bias, sums, one)
        _along(one, lanes, 1, near, near_bias, sums, other)
        _along(other, lanes, 2, far, far_bias, sums, one)
        for lane in range(min(lanes, len(offset) - b * lanes)):
            m = b * lanes + lane
            place, best, sure = _place(one, lanes, lane, score, score_bias, peak, logits)
            told[:-2] = cues[m]
            told[-2] = place / np.float32(4)
            told[-1] = sure
            offset[m] = place
            _errors(
                one, lanes, lane, best, told, hidden, hidden_bias, error, error_bias,
                log_error[m],
            )  # fmt: skip
