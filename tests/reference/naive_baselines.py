"""Slow, plain twins of the kernels of `emvs.baselines`."""

import math


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
