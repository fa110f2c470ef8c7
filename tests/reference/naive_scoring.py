"""Slow twins of masks, taxonomy, bootstrap and paired tests: loops from the definitions."""

import math
import statistics

import numpy as np
from scipy import stats


def edges(intensity, contrast):
    rows, columns = intensity.shape
    value = [[math.log(float(intensity[i, j]) + 8) for j in range(columns)] for i in range(rows)]

    def slope(low, high, apart):
        return (high - low) / apart

    found = np.zeros(intensity.shape, bool)
    for i in range(rows):
        for j in range(columns):
            up, down = max(i - 1, 0), min(i + 1, rows - 1)
            left, right = max(j - 1, 0), min(j + 1, columns - 1)
            v = slope(value[up][j], value[down][j], down - up)
            h = slope(value[i][left], value[i][right], right - left)
            found[i, j] = math.hypot(v, h) >= contrast
    return found


def grown(mask, radius):
    found = np.zeros(mask.shape, bool)
    for i, j in zip(*np.nonzero(mask), strict=True):
        found[max(i - radius, 0) : i + radius + 1, max(j - radius, 0) : j + radius + 1] = True
    return found


def events_near(camera, T_cam_world, images, points):
    """Events in the 3 x 3 pixels around each point's image, one piece of time after the other."""
    totals = []
    for point in points:
        total = 0
        for T, image in zip(T_cam_world, images, strict=True):
            x, y, z = (T @ np.append(point, 1.0))[:3]
            if z <= 0:
                continue
            u = round(camera.fx_px * x / z + camera.cx_px)
            v = round(camera.fy_px * y / z + camera.cy_px)
            if not (0 <= u < camera.width_px and 0 <= v < camera.height_px):
                continue
            total += image[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2].sum()
        totals.append(total)
    return totals


def bootstrap_means(groups, resamples, seed):
    """The drawn windows' own means, in the same order of draws."""
    rng = np.random.default_rng(seed)
    means = []
    for _ in range(resamples):
        seeds = [int(k) for k in rng.integers(len(groups), size=len(groups))]
        inner = []
        for k in seeds:
            drawn = [groups[k][int(w)] for w in rng.integers(len(groups[k]), size=len(groups[k]))]
            inner.append(sum(drawn) / len(drawn))
        means.append(sum(inner) / len(inner))
    return means


def interval(groups, resamples, seed, level):
    """Order of the resampled means, drawn out until they spread as seeds ask for."""
    own = [statistics.fmean(group) for group in groups]
    resampled = bootstrap_means(groups, resamples, seed)
    spread, mean = statistics.pstdev(resampled), statistics.fmean(own)
    if spread == 0:
        return mean, mean
    tail, error = (1 - level) / 2, statistics.stdev(own) / math.sqrt(len(own))
    error *= stats.t.isf(tail, len(own) - 1) / statistics.NormalDist().inv_cdf(1 - tail)
    ends = np.quantile(resampled, [tail, 1 - tail])
    return tuple(mean + error * (end - mean) / spread for end in ends)


def welch_interval(groups, level):
    """Mean of the groups' means, each group as uncertain as its own values say."""
    k = len(groups)
    variances = [statistics.variance(group) / len(group) / k**2 for group in groups]
    mean = statistics.fmean(statistics.fmean(group) for group in groups)
    total = sum(variances)
    if total == 0:
        return mean, mean
    rest = sum((v / total) ** 2 / (len(g) - 1) for v, g in zip(variances, groups, strict=True))
    half = stats.t.isf((1 - level) / 2, 1 / rest) * math.sqrt(total)
    return mean - half, mean + half


def holm(p):
    """Corrected p of each test: the least level at which the step-down procedure rejects it."""
    order = sorted(range(len(p)), key=lambda k: p[k])
    found = [0.0] * len(p)
    for place, k in enumerate(order):
        steps = [(len(p) - j) * p[order[j]] for j in range(place + 1)]
        found[k] = min(1.0, max(steps))
    return found
