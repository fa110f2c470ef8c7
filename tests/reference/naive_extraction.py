"""Slow, plain twins of the extraction by focus: one pixel at a time, in float64."""

import math

import numpy as np


def _mirror(k, size):
    """Index of an image mirrored at its rim, the rim's pixel not repeated."""
    while not 0 <= k < size:
        k = -k if k < 0 else 2 * (size - 1) - k
    return k


def _at(plane, y, x):
    return float(plane[_mirror(y, plane.shape[0]), _mirror(x, plane.shape[1])])


def _each(plane, value):
    height, width = plane.shape
    return np.array([[value(y, x) for x in range(width)] for y in range(height)])


def _around(plane, y, x, sigma_px):
    """(weight, value) of a pixel's surroundings; the weights sum to 1."""
    radius = round(4 * sigma_px)
    weight = [math.exp(-0.5 * (k / sigma_px) ** 2) for k in range(-radius, radius + 1)]
    total = sum(weight)
    for i, down in enumerate(weight):
        for j, across in enumerate(weight):
            value = _at(plane, y + i - radius, x + j - radius)
            yield down * across / total**2, value


def mean(plane, sigma_px):
    return _each(plane, lambda y, x: sum(w * v for w, v in _around(plane, y, x, sigma_px)))


def variance(plane, sigma_px):
    def at(y, x):
        pairs = list(_around(plane, y, x, sigma_px))
        middle = sum(w * v for w, v in pairs)
        return sum(w * (v - middle) ** 2 for w, v in pairs)

    return _each(plane, at)


def mean_square(plane, sigma_px):
    return _each(plane, lambda y, x: sum(w * v * v for w, v in _around(plane, y, x, sigma_px)))


def gradient(plane, sigma_px):
    def squared(y, x):
        smooth = (1, 2, 1)
        across = sum(
            s * (_at(plane, y + k, x + 1) - _at(plane, y + k, x - 1))
            for k, s in zip((-1, 0, 1), smooth, strict=True)
        )
        down = sum(
            s * (_at(plane, y + 1, x + k) - _at(plane, y - 1, x + k))
            for k, s in zip((-1, 0, 1), smooth, strict=True)
        )
        return (across / 8) ** 2 + (down / 8) ** 2

    return mean(_each(plane, squared), sigma_px)


def laplacian(plane, sigma_px):
    def squared(y, x):
        around = sum(_at(plane, y + v, x + u) for v, u in ((-1, 0), (1, 0), (0, -1), (0, 1)))
        return (around - 4 * _at(plane, y, x)) ** 2

    return mean(_each(plane, squared), sigma_px)


def difference_of_gaussians(plane, sigma_px):
    return mean(plane, sigma_px) - mean(plane, 1.6 * sigma_px)


def peak(ray):
    """(value, plane, left, right) of the first maximum along one ray; None beyond its ends."""
    plane = max(range(len(ray)), key=lambda k: (ray[k], -k))
    left = ray[plane - 1] if plane > 0 else None
    right = ray[plane + 1] if plane + 1 < len(ray) else None
    return ray[plane], plane, left, right


def _others(candidate, y, x, radius):
    """The candidates in a square around a pixel, without itself."""
    return [
        (v, u)
        for v in range(max(y - radius, 0), min(y + radius + 1, candidate.shape[0]))
        for u in range(max(x - radius, 0), min(x + radius + 1, candidate.shape[1]))
        if (v, u) != (y, x) and candidate[v, u]
    ]


def support(disparity, candidate, radius, tolerance):
    """Share of the candidates around each candidate that lie within the tolerance of it."""

    def at(y, x):
        others = _others(candidate, y, x, radius) if candidate[y, x] else []
        near = [abs(disparity[v, u] - disparity[y, x]) < tolerance for v, u in others]
        return sum(near) / len(near) if near else 0.0

    return _each(disparity, at)


def own_surface(disparity, candidate, radius, tolerance):
    """(x, y) way from each candidate to those like it, away from those behind it, on average."""
    towards = np.zeros((2, *candidate.shape))
    for y, x in np.argwhere(candidate):
        others = _others(candidate, y, x, radius)
        for v, u in others:
            apart = disparity[v, u] - disparity[y, x]
            sign = 1 if abs(apart) < tolerance else -1 if apart < 0 else 0
            towards[:, y, x] += np.array([sign * (u - x), sign * (v - y)]) / (len(others) + 1)
    return towards


def fitted_surface(disparity, candidate, weight, tolerance, ridge):
    """Weighted least squares by a linear solver: the plane's height at each candidate."""
    out, radius = np.zeros(disparity.shape), len(weight) - 1
    for y, x in np.argwhere(candidate):
        own = float(disparity[y, x])
        near = [(y, x), *_others(candidate, y, x, radius)]
        near = [(v, u) for v, u in near if abs(float(disparity[v, u]) - own) < tolerance]
        way = np.array([(u - x, v - y) for v, u in near], float)
        w = np.array([float(weight[abs(i)]) * float(weight[abs(j)]) for i, j in way.astype(int)])
        w /= w.sum()
        apart = np.array([float(disparity[v, u]) - own for v, u in near])
        middle, height = w @ way, w @ apart
        spread = (way - middle).T @ ((way - middle) * w[:, None]) + ridge * np.eye(2)
        slope = np.linalg.solve(spread, (way - middle).T @ ((apart - height) * w))
        out[y, x] = own + height - slope @ middle
    return out
