"""Ground truth in plain Python, pixel by pixel."""

from __future__ import annotations

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
    """(H, W): the two neighbours of every step of inverse depth that no plane explains."""
    rho = 1 / depth_m.astype(float)
    marked = np.zeros(depth_m.shape, bool)
    for line, mark in ((rho, marked), (rho.T, marked.T)):
        for i in range(line.shape[0]):
            for j in range(line.shape[1] - 1):
                step = line[i, j + 1] - line[i, j]
                others = [0.0]
                if j > 0:
                    others.append(line[i, j] - line[i, j - 1])
                if j + 2 < line.shape[1]:
                    others.append(line[i, j + 2] - line[i, j + 1])
                large = jump * max(line[i, j], line[i, j + 1])
                if all(abs(step - other) > large for other in others):
                    mark[i, j] = mark[i, j + 1] = True
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
