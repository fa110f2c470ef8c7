"""The slow twin of `plugins.diagnose.sharpness_kernels`: one vote at a time."""

import numpy as np


def naive_ray_maxima(rays, rho, width, height):
    """(H, W) the largest harmonic mean over planes of the cameras' bilinear votes.

    `rays`: per camera (a_u, b_u, a_v, b_v, c_z), each (N,).
    """
    best = np.zeros((height, width))
    for plane in rho:
        votes = np.array([_votes(columns, plane, width, height) for columns in rays])
        with np.errstate(divide="ignore"):
            best = np.maximum(best, len(rays) / (1 / votes).sum(axis=0))
    return best


def _votes(rays, rho, width, height):
    grid = np.zeros((height, width))
    for a_u, b_u, a_v, b_v, c_z in zip(*rays, strict=True):
        u, v = a_u + rho * b_u, a_v + rho * b_v
        if not (0 <= u < width - 1 and 0 <= v < height - 1) or 1 - c_z * rho <= 0:
            continue
        column, row = int(u), int(v)
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            weight = (1 - abs(u - column - dx)) * (1 - abs(v - row - dy))
            grid[row + dy, column + dx] += weight
    return grid
