"""DERD-Net as its definition reads, one pixel at a time: loops over steps and gates in float64."""

import math

import numpy as np


def place(arrays, column):
    """Where one model sees a pixel's depth.

    Args:
        arrays: weights by their published names.
        column: (D, S, S) shares of the largest value, near to far.

    Returns:
        0 at the near end of the range, 1 at the far end; not clipped.
    """
    w = {name: np.asarray(one, np.float64) for name, one in arrays.items()}
    state = [0.0] * 100
    for first in range(-1, len(column) - 1, 2):
        state = _unit(w, _step(w, column, first), state)
    hidden = [max(0.0, v) for v in _dense(w, "dense_output.0", state)]
    return _dense(w, "dense_output.3", hidden)[0]


def _step(w, column, first):
    """The 4 x 5 x 5 features of three planes, channel after channel; planes outside are empty."""
    planes = [column[d] if 0 <= d < len(column) else np.zeros(column.shape[1:]) for d in
              range(first, first + 3)]  # fmt: skip
    block, side = np.stack(planes), column.shape[1] - 2
    features = []
    for kernel, bias in zip(w["conv3d.0.weight"], w["conv3d.0.bias"], strict=True):
        for y in range(side):
            for x in range(side):
                total = (kernel[0] * block[:, y : y + 3, x : x + 3]).sum() + bias
                features.append(max(0.0, total))
    return features


def _unit(w, told, state):
    """One step of the gated recurrent unit, as torch defines it."""
    mine = w["gru.weight_ih_l0"] @ told + w["gru.bias_ih_l0"]
    own = w["gru.weight_hh_l0"] @ state + w["gru.bias_hh_l0"]
    units, after = len(state), []
    for j, before in enumerate(state):
        reset = _sigmoid(mine[j] + own[j])
        update = _sigmoid(mine[units + j] + own[units + j])
        new = math.tanh(mine[2 * units + j] + reset * own[2 * units + j])
        after.append((1 - update) * new + update * before)
    return after


def _dense(w, layer, values):
    return list(w[f"{layer}.weight"] @ values + w[f"{layer}.bias"])


def _sigmoid(value):
    return 1 / (1 + math.exp(-value))
