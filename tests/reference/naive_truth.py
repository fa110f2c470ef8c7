"""Ground truth in plain Python, pixel by pixel."""

import numpy as np


def flow_px(camera, depth_m, T_later_now):
    """(H, W, 2): each pixel's point, moved and projected by itself."""
    flow = np.full((*depth_m.shape, 2), np.nan)
    for row, column in np.ndindex(depth_m.shape):
        x, y = camera.unproject(np.array([column, row], float))
        z = min(float(depth_m[row, column]), 1e12)
        moved = T_later_now @ np.array([x * z, y * z, z, 1.0])
        if moved[2] > 0:
            flow[row, column] = camera.project(moved[:3]) - (column, row)
    return flow


def boundary(depth_m, jump):
    """(H, W): the two ends of every step of inverse depth, in four directions, that is no plane."""
    rho = 1 / depth_m.astype(float)
    height, width = rho.shape
    marked = np.zeros(depth_m.shape, bool)

    def at(i, j):
        return rho[i, j] if 0 <= i < height and 0 <= j < width else None

    for di, dj in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for i, j in np.ndindex(height, width):
            there = at(i + di, j + dj)
            if there is None:
                continue
            step, before, behind = there - rho[i, j], at(i - di, j - dj), at(i + 2 * di, j + 2 * dj)
            others = [] if before is None else [rho[i, j] - before]
            others += [] if behind is None else [behind - there]
            large = jump * max(rho[i, j], there)
            if others and all(abs(step - other) > large for other in [0.0, *others]):
                marked[i, j] = marked[i + di, j + dj] = True
    return marked


def depth_at_events(before_m, after_m, before_us, after_us, events, same):
    """(N,): inverse depth interpolated in time, or the nearer one where an edge passed."""
    depth_m = []
    for x, y, t_us in zip(events.x, events.y, events.t_us, strict=True):
        a, b = 1 / float(before_m[y, x]), 1 / float(after_m[y, x])
        share = max(0, int(t_us) - before_us) / (after_us - before_us)
        rho = a + share * (b - a) if abs(a - b) <= same * max(a, b) else max(a, b)
        depth_m.append(1 / rho if rho else np.inf)
    return np.array(depth_m)
