"""The compiled loops of DERD-Net: some pixels side by side in every loop, one block a thread."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

import numpy as np
from numba import njit, prange

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

_ZERO, _ONE = np.float32(0), np.float32(1)
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


@njit(cache=True)
def only_positive(out):
    """Sets what is below 0 to 0."""
    for x in range(len(out)):
        value = out[x]
        out[x] = value if value > _ZERO else _ZERO


@njit(cache=True)
def _steps(column, lanes, weight, bias, out):
    """3 x 3 x 3 windows around every second plane: (D, S, S L) to out (T, O (S - 2) (S - 2) L)."""
    depth, side = column.shape[0], column.shape[1] - 2
    width = side * lanes
    for t in range(out.shape[0]):
        for o in range(len(bias)):
            for y in range(side):
                first = (o * side + y) * width
                row = out[t, first : first + width]
                row[:] = bias[o]
                for k in range(max(0, 1 - 2 * t), min(3, depth + 1 - 2 * t)):
                    plane = column[2 * t + k - 1]
                    add_nine(plane[y], plane[y + 1], plane[y + 2], lanes, weight[o, 0, k], row)
                only_positive(row)


@njit(cache=True, fastmath=_CONTRACT)
def _layer(values, matrix, bias, out):
    """A layer of weights (O, I), I a multiple of 5: values (I L) to out (O, L)."""
    lanes = out.shape[1]
    for o in range(out.shape[0]):
        total, weight = out[o], matrix[o]
        total[:] = bias[o]
        for i in range(0, len(weight), 5):
            a = values[i * lanes : (i + 1) * lanes]
            b = values[(i + 1) * lanes : (i + 2) * lanes]
            c = values[(i + 2) * lanes : (i + 3) * lanes]
            d = values[(i + 3) * lanes : (i + 4) * lanes]
            e = values[(i + 4) * lanes : (i + 5) * lanes]
            w0, w1, w2 = weight[i], weight[i + 1], weight[i + 2]
            w3, w4 = weight[i + 3], weight[i + 4]
            for x in range(lanes):
                total[x] += (w0 * a[x] + w1 * b[x] + w2 * c[x]) + (w3 * d[x] + w4 * e[x])


@njit(cache=True)
def _gates(from_input, from_state, state):
    """One step of a gated recurrent unit; both gates (3 H, L), in the order of torch."""
    hidden, lanes = state.shape
    for j in range(hidden):
        for x in range(lanes):
            reset = _ONE / (_ONE + np.exp(-(from_input[j, x] + from_state[j, x])))
            update = _ONE / (
                _ONE + np.exp(-(from_input[hidden + j, x] + from_state[hidden + j, x]))
            )
            new = np.tanh(from_input[2 * hidden + j, x] + reset * from_state[2 * hidden + j, x])
            state[j, x] = (_ONE - update) * new + update * state[j, x]


@njit(parallel=True, cache=True)
def places(
    columns, conv, conv_bias, from_input, input_bias, from_state, state_bias, hidden, hidden_bias,
    last, last_bias, out,
):  # fmt: skip
    """Fills `out` with where one model sees each pixel's depth.

    Arrays:
        columns: (B, D, S, S L) float32; pixel m is lane m % L of block m // L.
        conv, conv_bias: (O, 1, 3, 3, 3) and (O,).
        from_input, input_bias, from_state, state_bias: (3 H, I), (3 H,), (3 H, H), (3 H,) of the
            recurrent unit; gates in the order reset, update, new.
        hidden, hidden_bias, last, last_bias: (H, H), (H,), (1, H), (1,).
        out: (M,) float32, filled: 0 at the near end of the depth range, 1 at the far end.
    """
    blocks, depth, side, width = columns.shape
    lanes, units = width // side, len(hidden_bias)
    for b in prange(blocks):
        steps = np.empty(((depth + 1) // 2, from_input.shape[1] * lanes), np.float32)
        gates = np.empty((2, 3 * units, lanes), np.float32)
        mine, own = gates[0], gates[1]
        state = np.zeros((units, lanes), np.float32)
        place = np.empty((1, lanes), np.float32)
        _steps(columns[b], lanes, conv, conv_bias, steps)
        for t in range(len(steps)):
            _layer(steps[t], from_input, input_bias, mine)
            _layer(state.reshape(units * lanes), from_state, state_bias, own)
            _gates(mine, own, state)
        _layer(state.reshape(units * lanes), hidden, hidden_bias, mine[:units])
        for j in range(units):
            only_positive(mine[j])
        _layer(mine[:units].reshape(units * lanes), last, last_bias, place)
        for lane in range(min(lanes, len(out) - b * lanes)):
            out[b * lanes + lane] = place[0, lane]
