"""The GPU's loops of the focus measures (`emvs.dsi.focus_measures`), several planes at a time.

All arrays are (P, cells) float32, cells = H * W, and the grid is (blocks, P) unless said otherwise.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, attr-defined"

import numpy as np
from numba import cuda

SQUARE, GRADIENT, LAPLACIAN = range(3)

_ZERO, _TWO, _FOUR, _EIGHTH = np.float32(0), np.float32(2), np.float32(4), np.float32(0.125)


@cuda.jit(device=True)
def _mirrored(i, size):
    """Index of a row that is mirrored at its ends, which stand once."""
    while i < 0 or i >= size:  # hardly ever: a division would cost more
        if size == 1:
            return 0
        i = -i if i < 0 else 2 * (size - 1) - i
    return i


@cuda.jit(device=True)
def _at(image, p, x, y, width, height):
    return image[p, _mirrored(y, height) * width + _mirrored(x, width)]


@cuda.jit(device=True)
def _slope(image, p, x, y, dx, dy, width, height):
    """Sobel's slope along (dx, dy): a difference, smoothed across by 1, 2, 1."""
    total = _ZERO
    for side in range(-1, 2):
        weight = _TWO - np.float32(abs(side))
        ahead = _at(image, p, x + dx + side * dy, y + dy + side * dx, width, height)
        behind = _at(image, p, x - dx + side * dy, y - dy + side * dx, width, height)
        total += weight * (ahead - behind)
    return total * _EIGHTH


@cuda.jit(cache=True)
def sharpness(kind, image, width, out):
    """Fills `out` with what is averaged: squares of the votes, of their gradient or Laplacian."""
    p, c = cuda.blockIdx.y, cuda.grid(1)
    while c < image.shape[1]:
        height = image.shape[1] // width
        y, x = c // width, c % width
        if kind == SQUARE:
            out[p, c] = image[p, c] * image[p, c]
        elif kind == GRADIENT:
            across = _slope(image, p, x, y, 1, 0, width, height)
            down = _slope(image, p, x, y, 0, 1, width, height)
            out[p, c] = across * across + down * down
        else:
            around = _at(image, p, x - 1, y, width, height) + _at(image, p, x + 1, y, width, height)
            around += _at(image, p, x, y - 1, width, height)
            around += _at(image, p, x, y + 1, width, height)
            bend = around - _FOUR * image[p, c]
            out[p, c] = bend * bend
        c += cuda.gridDim.x * cuda.blockDim.x


@cuda.jit(cache=True)
def blur(image, weight, width, dx, dy, out):
    """Weighted mean along (dx, dy), the image mirrored at its rim; `weight` (r + 1,) is half."""
    p, c = cuda.blockIdx.y, cuda.grid(1)
    while c < image.shape[1]:
        height = image.shape[1] // width
        y, x = c // width, c % width
        total = weight[0] * image[p, c]
        for k in range(1, len(weight)):
            before = _at(image, p, x - k * dx, y - k * dy, width, height)
            after = _at(image, p, x + k * dx, y + k * dy, width, height)
            total += weight[k] * (before + after)
        out[p, c] = total
        c += cuda.gridDim.x * cuda.blockDim.x


@cuda.jit(cache=True)
def spread(square, mean):
    """Turns means of squares into variances, in place."""
    p, c = cuda.blockIdx.y, cuda.grid(1)
    while c < square.shape[1]:
        square[p, c] = max(square[p, c] - mean[p, c] * mean[p, c], _ZERO)
        c += cuda.gridDim.x * cuda.blockDim.x


@cuda.jit(cache=True)
def subtract(narrow, wide):
    """Subtracts the wider mean from the narrower, in place."""
    p, c = cuda.blockIdx.y, cuda.grid(1)
    while c < narrow.shape[1]:
        narrow[p, c] -= wide[p, c]
        c += cuda.gridDim.x * cuda.blockDim.x
