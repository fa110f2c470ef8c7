"""The compiled loops of the network: some pixels side by side in every loop, one block a thread.

Lanes are innermost: the votes of one cell for all pixels of a block. A shift by one column is then
a shift by one block of lanes, so every loop runs over a contiguous row, and vectorises.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

import numpy as np
from numba import njit, prange

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

PAD = 4
"""Samples of nothing before and behind a ray: as far as its convolutions reach."""
_ZERO = np.float32(0)
_CONTRACT = {"contract"}  # a product and a sum in one instruction; the order of sums stays


@njit(cache=True, fastmath=_CONTRACT)
def add_nine(top, middle, bottom, lanes, weight, out):
    """Adds a 3 x 3 window of one channel to a row of pixels."""
    n = len(out)
    a, b, c = top[:n], top[lanes : lanes + n], top[2 * lanes : 2 * lanes + n]
    d, e, f = middle[:n], middle[lanes : lanes + n], middle[2 * lanes : 2 * lanes + n]
    g, h, i = bottom[:n], bottom[lanes : lanes + n], bottom[2 * lanes : 2 * lanes + n]
    w0, w1, w2 = weight[0, 0], weight[0, 1], weight[0, 2]
    w3, w4, w5 = weight[1, 0], weight[1, 1], weight[1, 2]
    w6, w7, w8 = weight[2, 0], weight[2, 1], weight[2, 2]
    for x in range(n):
        upper = w0 * a[x] + w1 * b[x] + w2 * c[x]
        centre = w3 * d[x] + w4 * e[x] + w5 * f[x]
        out[x] += upper + centre + (w6 * g[x] + w7 * h[x] + w8 * i[x])


@njit(cache=True, fastmath=_CONTRACT)
def _five(row, step, weight, out):
    """Adds five taps of one row, `step` apart."""
    n = len(out)
    a, b, c = row[:n], row[step : step + n], row[2 * step : 2 * step + n]
    d, e = row[3 * step : 3 * step + n], row[4 * step : 4 * step + n]
    w0, w1, w2, w3, w4 = weight[0], weight[1], weight[2], weight[3], weight[4]
    for x in range(n):
        out[x] += (w0 * a[x] + w1 * b[x] + w2 * c[x]) + (w3 * d[x] + w4 * e[x])


@njit(cache=True)
def only_positive(out):
    """Sets what is below 0 to 0."""
    for x in range(len(out)):
        value = out[x]
        out[x] = value if value > _ZERO else _ZERO


@njit(cache=True)
def _patch(shares, lanes, weight, bias, out):
    """3 x 3 x 3 windows: shares (K, D, S, S L) to out (O, D, S - 2, (S - 2) L)."""
    channels, depth = shares.shape[:2]
    for o in range(out.shape[0]):
        for d in range(depth):
            for y in range(out.shape[2]):
                row = out[o, d, y]
                row[:] = bias[o]
                for c in range(channels):
                    for k in range(max(0, 1 - d), min(3, depth + 1 - d)):
                        plane = shares[c, d + k - 1]
                        add_nine(plane[y], plane[y + 1], plane[y + 2], lanes, weight[o, c, k], row)
                only_positive(row)


@njit(cache=True)
def _ray(cells, lanes, weight, bias, out):
    """5 x 5 x 3 windows down to the ray: cells (O, D, 5, 5 L) to out (R, (D + 2 PAD) L)."""
    channels, depth = cells.shape[:2]
    for o in range(out.shape[0]):
        for d in range(depth):
            row = out[o, (d + PAD) * lanes : (d + PAD + 1) * lanes]
            row[:] = bias[o]
            for c in range(channels):
                for k in range(max(0, 1 - d), min(3, depth + 1 - d)):
                    for y in range(5):
                        _five(cells[c, d + k - 1, y], lanes, weight[o, c, k, y], row)
            only_positive(row)


@njit(cache=True)
def _along(ray, lanes, dilation, weight, bias, spare, out):
    """Five taps along the ray, added to it: ray and out (R, (D + 2 PAD) L)."""
    first = (PAD - 2 * dilation) * lanes
    pad = PAD * lanes
    count = ray.shape[1] - 2 * pad
    for o in range(ray.shape[0]):
        spare[:] = bias[o]
        for c in range(ray.shape[0]):
            _five(ray[c, first:], dilation * lanes, weight[o, c], spare)
        only_positive(spare)
        row, added = ray[o, pad : pad + count], out[o, pad : pad + count]
        for x in range(count):
            added[x] = row[x] + spare[x]


@njit(cache=True)
def _place(ray, lanes, lane, weight, bias, peak, logits):
    """Soft maximum of one pixel's logits: its place, the best sample, the share around it."""
    depth = len(logits)
    best = 0
    for d in range(depth):
        total = bias[0]
        for c in range(ray.shape[0]):
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
    features = ray.shape[0]
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
        patch ... error_bias: the weights, as `emvs.learned.network.Network` names them.
        peak: samples on either side of the best one that decide where the depth lies.
        offset: (M,) float32, filled: samples from the patch's middle.
        log_error: (M, 2) float32, filled.
    """
    blocks, _, depth, side, width = shares.shape
    lanes = width // side
    for b in prange(blocks):
        cells = np.empty((len(patch_bias), depth, side - 2, (side - 2) * lanes), np.float32)
        rays = np.zeros((2, len(ray_bias), (depth + 2 * PAD) * lanes), np.float32)
        spare = np.empty(depth * lanes, np.float32)
        logits = np.empty(depth, np.float32)
        told = np.empty(cues.shape[1] + 2, np.float32)
        one, other = rays[0], rays[1]
        _patch(shares[b], lanes, patch, patch_bias, cells)
        _ray(cells, lanes, ray, ray_bias, one)
        _along(one, lanes, 1, near, near_bias, spare, other)
        _along(other, lanes, 2, far, far_bias, spare, one)
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
