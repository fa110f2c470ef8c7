"""Slow, plain twins of the kernels of `emvs.baselines`."""

import math

import numpy as np


def time_surface(width, height, events, t_us, decay_s):
    """Rows of exp(-(t - t_last) / decay), 0 where nothing fired yet."""
    last = [[None] * width for _ in range(height)]
    for x, y, when in zip(*(c.tolist() for c in (events.x, events.y, events.t_us)), strict=True):
        last[y][x] = when
    return [
        [0.0 if when is None else math.exp((when - t_us) * 1e-6 / decay_s) for when in row]
        for row in last
    ]


def nearest_points(points_rv, values, K, width, height):
    """Pixel (row, column) -> (z, value) of the nearest point that it sees; of equals the first."""
    best = {}
    for (x, y, z), value in zip(points_rv.tolist(), values.tolist(), strict=True):
        if not z > 0:
            continue
        column = math.floor(K[0][0] * x / z + K[0][2] + 0.5)
        row = math.floor(K[1][1] * y / z + K[1][2] + 0.5)
        if 0 <= row < height and 0 <= column < width:
            known = best.get((row, column))
            if known is None or z < known[0]:
                best[row, column] = (z, value)
    return best


def zncc(left, right, u, v, d, half):
    """ZNCC of the block around (u, v) and the one d columns further left."""
    x, y = half
    one = left[v - y : v + y + 1, u - x : u + x + 1].astype(float)
    other = right[v - y : v + y + 1, u - d - x : u - d + x + 1].astype(float)
    one, other = one - one.mean(), other - other.mean()
    return float((one * other).sum() / math.sqrt((one**2).sum() * (other**2).sum()))


def bilinear(image, x, y):
    i, j = math.floor(x), math.floor(y)
    fx, fy = x - i, y - j
    top = (1 - fx) * image[j, i] + fx * image[j, i + 1]
    bottom = (1 - fx) * image[j + 1, i] + fx * image[j + 1, i + 1]
    return (1 - fy) * float(top) + fy * float(bottom)


def residuals(left, right, a, b, camera, rho, half):
    """Differences of two patches, seen at inverse depth rho."""
    f, cx, cy, baseline = camera
    x, y, z = np.asarray(a) + rho * np.asarray(b)
    u, v = f * x / z + cx, f * y / z + cy
    w = f * (x - baseline * rho) / z + cx
    return np.array([
        bilinear(left, u + i, v + j) - bilinear(right, w + i, v + j)
        for j in range(-half[1], half[1] + 1) for i in range(-half[0], half[0] + 1)
    ])  # fmt: skip


def cost(left, right, a, b, camera, rho, half, dof, scale):
    """Negative log-likelihood, times 2 and without its constant, of a patch's differences."""
    differences = residuals(left, right, a, b, camera, rho, half)
    return sum((dof + 1) * math.log1p((r / scale) ** 2 / dof) for r in differences.tolist())


def weighted(differences, dof, scale):
    """Residuals times the square roots of their Student t weights."""
    return differences * np.sqrt((dof + 1) / (dof + (differences / scale) ** 2))


def spread(differences, dof, scale):
    """Scale at which the mean square of the weighted residuals is its square."""
    for _ in range(500):
        scale = math.sqrt((weighted(differences, dof, scale) ** 2).mean())
    return scale


def smooth(rho, deviation, radius, least):
    """Mean over compatible neighbours, weighted by inverse variance."""
    out = np.full(rho.shape, np.nan)
    for v, u in np.argwhere(np.isfinite(rho)):
        rows = slice(max(0, v - radius), v + radius + 1)
        columns = slice(max(0, u - radius), u + radius + 1)
        near, width = rho[rows, columns].ravel(), deviation[rows, columns].ravel()
        like = np.abs(near - rho[v, u]) <= 2 * np.maximum(width, deviation[v, u])
        if like.sum() > least:
            out[v, u] = np.average(near[like], weights=width[like] ** -2)
    return out


def best_pairs(left, right, low, high, settings):
    """For each left event, index of the right one of least energy, -1 for none."""
    found = []
    for k in range(len(left.t_us)):
        best, where = settings.most_energy, -1
        for m in range(len(right.t_us)):
            du, dv = left.uv_px[k] - right.uv_px[m]
            dt = float(right.t_us[m] - left.t_us[k])
            far = abs(dv) > 2 * settings.row_px or abs(dt) > 2 * settings.time_us
            if far or not low <= du <= high or left.p[k] != right.p[m]:
                continue
            one, other = left.slope[k], right.slope[m]
            moved = 2 * ((one - other) ** 2).sum() / ((one**2).sum() + (other**2).sum())
            value = (dv / settings.row_px) ** 2 + (dt / settings.time_us) ** 2
            value += moved / settings.motion**2
            if value < best:
                best, where = value, m
        found.append(where)
    return np.array(found)
