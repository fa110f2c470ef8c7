"""The network of the learned extraction as its definition reads: sliding windows and einsum."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view


def judged(arrays, shares, cues, peak):
    """Offset and logarithms of both errors of pixels.

    Args:
        arrays: weights by name.
        shares: (M, 3, D, S, S).
        cues: (M, F).
        peak: samples beside the best that decide.

    Returns:
        (M,) and (M, 2) float64.
    """
    w = {name: np.asarray(one, np.float64) for name, one in arrays.items()}
    cells = _volume(np.asarray(shares, np.float64), w["patch.weight"], w["patch.bias"])
    ray = _volume(cells, w["ray.weight"], w["ray.bias"])[..., 0, 0]
    ray = ray + _line(ray, w["near.weight"], w["near.bias"], 1)
    ray = ray + _line(ray, w["far.weight"], w["far.bias"], 2)
    logits = np.einsum("mcd,oc->md", ray, w["score.weight"][..., 0]) + w["score.bias"]
    share = np.exp(logits - logits.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    best = logits.argmax(axis=1)
    sample = np.arange(logits.shape[1])
    near = np.where(abs(sample - best[:, None]) <= peak, share, 0)
    offset = (near * sample).sum(axis=1) / near.sum(axis=1) - len(sample) // 2
    told = np.column_stack([cues, offset / 4, near.sum(axis=1)])
    features = np.column_stack([ray[np.arange(len(ray)), :, best], told])
    hidden = np.maximum(features @ w["hidden.weight"].T + w["hidden.bias"], 0)
    return offset, hidden @ w["error.weight"].T + w["error.bias"]


def _volume(x, weight, bias):
    """Convolution over depth, rows and columns; padded along depth only."""
    padded = np.pad(x, ((0, 0), (0, 0), (1, 1), (0, 0), (0, 0)))
    windows = sliding_window_view(padded, weight.shape[2:], axis=(2, 3, 4))
    out = np.einsum("mcdyxkij,ockij->modyx", windows, weight)
    return np.maximum(out + bias[:, None, None, None], 0)


def _line(x, weight, bias, dilation):
    """Convolution of five taps along the ray, padded."""
    padded = np.pad(x, ((0, 0), (0, 0), (2 * dilation, 2 * dilation)))
    windows = sliding_window_view(padded, 4 * dilation + 1, axis=2)[..., ::dilation]
    return np.maximum(np.einsum("mcdk,ock->mod", windows, weight) + bias[:, None], 0)
