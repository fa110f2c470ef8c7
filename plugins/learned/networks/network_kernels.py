"""The compiled loops of the network: some pixels side by side in every loop, one block a thread.

Lanes are innermost, the votes of one cell for all pixels of a block, and the ray is next: a step
along the ray is a shift by one block of lanes. So every convolution is one loop over another list
of taps, `_window`, which keeps its sums in registers; nothing else here takes much time.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg, var-annotated"

import numpy as np
from numba import njit, prange

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.depth.kept_votes_kernels import LANES
from eventsweep.emvs.utils.vectors_kernels import WIDTH, aligned, larger, load, plus, splat, store

PAD = 4
"""Samples of nothing before and behind a ray: as far as its convolutions reach."""
FEW = 8
"""Channels that are summed side by side: what is loaded once serves all of them."""
_STRIPS = 8  # of blocks: each has scratch of its own, and threads share them evenly enough
_ZERO = np.float32(0)


@njit(cache=True)
def _rays(shape, samples):
    """Zeros: rays of so many samples, of all lanes."""
    whole = (*shape, samples * LANES)
    count = samples * LANES
    for size in shape:
        count *= size
    return aligned(count).reshape(whole)


@njit(cache=True)
def _write(sum0, sum1, sum2, sum3, sum4, sum5, sum6, sum7, out, to, step):
    """Stores what is positive of eight channels' sums, `step` numbers from one to the next."""
    nothing = splat(_ZERO)
    store(out, to, larger(sum0, nothing))
    store(out, to + step, larger(sum1, nothing))
    store(out, to + 2 * step, larger(sum2, nothing))
    store(out, to + 3 * step, larger(sum3, nothing))
    store(out, to + 4 * step, larger(sum4, nothing))
    store(out, to + 5 * step, larger(sum5, nothing))
    store(out, to + 6 * step, larger(sum6, nothing))
    store(out, to + 7 * step, larger(sum7, nothing))


@njit(cache=True)
def _one_vector(values, at, taps, weight, bias, out, to, step):
    """What is positive of eight channels of a convolution, at one place, for one vector of lanes.

    Eight sums, one for each channel, fit in sixteen registers.

    Arrays:
        values: (N,) float32, the place at number `at`.
        taps: (T,) int64, numbers from there to each input.
        weight, bias: (T, 8) and (8,) float32.
        out: (M,) float32, filled from number `to` on, each channel `step` numbers further.
    """
    sum0, sum1, sum2, sum3 = splat(bias[0]), splat(bias[1]), splat(bias[2]), splat(bias[3])
    sum4, sum5, sum6, sum7 = splat(bias[4]), splat(bias[5]), splat(bias[6]), splat(bias[7])
    for t in range(len(taps)):
        value, w = load(values, at + taps[t]), weight[t]
        sum0, sum1 = plus(sum0, splat(w[0]), value), plus(sum1, splat(w[1]), value)
        sum2, sum3 = plus(sum2, splat(w[2]), value), plus(sum3, splat(w[3]), value)
        sum4, sum5 = plus(sum4, splat(w[4]), value), plus(sum5, splat(w[5]), value)
        sum6, sum7 = plus(sum6, splat(w[6]), value), plus(sum7, splat(w[7]), value)
    _write(sum0, sum1, sum2, sum3, sum4, sum5, sum6, sum7, out, to, step)


@njit(cache=True)
def _two_vectors(values, at, taps, weight, bias, out, to, step):
    """As `_one_vector`, for lanes that are two vectors, near and far: a weight serves both."""
    near0, near1, near2, near3 = splat(bias[0]), splat(bias[1]), splat(bias[2]), splat(bias[3])
    near4, near5, near6, near7 = splat(bias[4]), splat(bias[5]), splat(bias[6]), splat(bias[7])
    far0, far1, far2, far3, far4, far5 = near0, near1, near2, near3, near4, near5
    far6, far7 = near6, near7
    for t in range(len(taps)):
        near, far, w = load(values, at + taps[t]), load(values, at + taps[t] + WIDTH), weight[t]
        even, odd = splat(w[0]), splat(w[1])
        near0, near1 = plus(near0, even, near), plus(near1, odd, near)
        far0, far1 = plus(far0, even, far), plus(far1, odd, far)
        even, odd = splat(w[2]), splat(w[3])
        near2, near3 = plus(near2, even, near), plus(near3, odd, near)
        far2, far3 = plus(far2, even, far), plus(far3, odd, far)
        even, odd = splat(w[4]), splat(w[5])
        near4, near5 = plus(near4, even, near), plus(near5, odd, near)
        far4, far5 = plus(far4, even, far), plus(far5, odd, far)
        even, odd = splat(w[6]), splat(w[7])
        near6, near7 = plus(near6, even, near), plus(near7, odd, near)
        far6, far7 = plus(far6, even, far), plus(far7, odd, far)
    _write(near0, near1, near2, near3, near4, near5, near6, near7, out, to, step)
    _write(far0, far1, far2, far3, far4, far5, far6, far7, out, to + WIDTH, step)


_window = _two_vectors if LANES > WIDTH else _one_vector


@njit(cache=True)
def _patch(places, taps, weight, bias, out):
    """3 x 3 x 3 windows: places (K, S, S, (D + 2) L) to out (O, S - 2, S - 2, (D + 2) L)."""
    side, ray = places.shape[1], places.shape[3]
    within = out.shape[1]
    step = within * within * ray
    values, filled = places.reshape(places.size), out.reshape(out.size)
    for group in range(len(weight)):
        few = slice(FEW * group, FEW * group + FEW)
        for y in range(within):
            for x in range(within):
                first = (y * side + x) * ray
                to = FEW * group * step + (y * within + x) * ray + LANES
                for d in range(0, ray - 2 * LANES, LANES):
                    _window(values, first + d, taps, weight[group], bias[few], filled, to + d, step)


@njit(cache=True)
def _ray(cells, taps, weight, bias, out):
    """5 x 5 x 3 windows down to the ray: cells (O, 5, 5, (D + 2) L) to out (R, (D + 2 PAD) L)."""
    step = out.shape[1]
    values, filled = cells.reshape(cells.size), out.reshape(out.size)
    for d in range(0, cells.shape[3] - 2 * LANES, LANES):
        for group in range(len(weight)):
            few = slice(FEW * group, FEW * group + FEW)
            to = FEW * group * step + PAD * LANES + d
            _window(values, d, taps, weight[group], bias[few], filled, to, step)


@njit(cache=True)
def _along(ray, reach, taps, weight, bias, out):
    """Five taps along the ray, added to it: ray and out (R, (D + 2 PAD) L)."""
    step = out.shape[1]
    values, filled = ray.reshape(ray.size), out.reshape(out.size)
    for group in range(len(weight)):
        few = slice(FEW * group, FEW * group + FEW)
        for at in range(PAD * LANES, step - PAD * LANES, LANES):
            to = FEW * group * step + at
            _window(values, at - reach * LANES, taps, weight[group], bias[few], filled, to, step)
    for k in range(len(filled)):
        filled[k] += values[k]


@njit(cache=True)
def _logits(ray, weight, bias, logits):
    """Weighted sums of channels (R, (D + 2 PAD) L), at every sample, to logits (D L)."""
    logits[:] = bias[0]
    for c in range(weight.shape[1]):
        row, w = ray[c][PAD * LANES :], weight[0, c, 0]
        for k in range(len(logits)):
            logits[k] += w * row[k]


@njit(cache=True)
def _place(logits, lane, peak):
    """Soft maximum of one pixel's logits: its place, the best sample, the share around it."""
    depth = len(logits) // LANES
    best = 0
    for d in range(depth):
        if logits[d * LANES + lane] > logits[best * LANES + lane]:
            best = d
    top = logits[best * LANES + lane]
    every, near, place = _ZERO, _ZERO, _ZERO
    for d in range(depth):
        share = np.exp(logits[d * LANES + lane] - top)
        every += share
        if abs(d - best) <= peak:
            near += share
            place += share * np.float32(d)
    return place / near - np.float32(depth // 2), best, near / every


@njit(cache=True)
def _fill_lane(ray, lane, best, cues, place, sure, features):
    """One lane of what the errors depend on (F, L): the ray at the best sample, and the cues."""
    deep = len(ray)
    for c in range(deep):
        features[c, lane] = ray[c, (best + PAD) * LANES + lane]
    for c in range(len(cues)):
        features[deep + c, lane] = cues[c]
    features[-2, lane] = place / np.float32(4)
    features[-1, lane] = sure


@njit(cache=True)
def _errors(features, hidden, hidden_bias, error, error_bias, total, log_error):
    """Expected errors of all lanes, (2, L), from their features (F, L)."""
    for k in range(len(log_error)):
        log_error[k][:] = error_bias[k]
    for h in range(len(hidden_bias)):
        total[:] = hidden_bias[h]
        for c in range(len(features)):
            row, w = features[c], hidden[h, c]
            for x in range(LANES):
                total[x] += w * row[x]
        for k in range(len(log_error)):
            row, w = log_error[k], error[k, h]
            for x in range(LANES):
                row[x] += w * max(total[x], _ZERO)


@njit(parallel=True, cache=True)
def judge(
    shares, cues, patch, ray, near, far, score, score_bias, hidden, hidden_bias, error, error_bias,
    peak, offset, log_error,
):  # fmt: skip
    """Fills `offset` and `log_error` with what the network says of every pixel.

    Arrays:
        shares: (B, K, S, S, (D + 2) L) float32, nothing at both ends of each ray.
        cues: (M, F) float32; pixel m is lane m % L of block m // L.
        patch, ray, near, far: taps (T,) int64, weights (O / 4, T, 4) and biases (O,) float32 of the
            convolutions: O a multiple of `FEW`, filled up with zeros.
        score ... error_bias: the other weights, as `network.Architecture` names them.
        peak: samples on either side of the best one that decide where the depth lies.
        offset: (M,) float32, filled: samples from the patch's middle.
        log_error: (M, 2) float32, filled.
    """
    blocks, _, side, _, long = shares.shape
    depth = long // LANES - 2
    wide, deep = len(patch[2]), len(ray[2])
    deepest = score.shape[1]
    strips = min(blocks, _STRIPS)
    for s in prange(strips):
        cells = _rays((wide, side - 2, side - 2), depth + 2)
        front, back = _rays((deep,), depth + 2 * PAD), _rays((deep,), depth + 2 * PAD)
        logits, total = np.empty(depth * LANES, np.float32), np.empty(LANES, np.float32)
        features = np.zeros((hidden.shape[1], LANES), np.float32)
        errors = np.empty((2, LANES), np.float32)
        for b in range(s * blocks // strips, (s + 1) * blocks // strips):
            _patch(shares[b], *patch, cells)
            _ray(cells, *ray, front)
            _along(front, 2, *near, back)
            _along(back, 4, *far, front)
            _logits(front, score, score_bias, logits)
            here = range(min(LANES, len(offset) - b * LANES))
            for lane in here:
                m = b * LANES + lane
                offset[m], best, sure = _place(logits, lane, peak)
                _fill_lane(front[:deepest], lane, best, cues[m], offset[m], sure, features)
            _errors(features, hidden, hidden_bias, error, error_bias, total, errors)
            for lane in here:
                log_error[b * LANES + lane] = errors[:, lane]
