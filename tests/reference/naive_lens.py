"""What a lens map is for, in plain loops."""

import numpy as np


def resample(luma, window_depth, position, step, supersample):
    """Mean of bilinear looks, and the largest window depth of the samples looked at."""
    intensity, nearest = np.zeros(position.shape[:2]), np.zeros(position.shape[:2], np.float32)
    offsets = (np.arange(supersample) + 0.5) / supersample - 0.5
    for v, u in np.ndindex(intensity.shape):
        looks = []
        for dv in offsets:
            for du in offsets:
                x, y = position[v, u] + step[v, u] @ np.array([du, dv], np.float32)
                j, i = int(x), int(y)
                square = luma[i : i + 2, j : j + 2].astype(float)
                looks.append(np.array([1 - (y - i), y - i]) @ square @ [1 - (x - j), x - j])
                nearest[v, u] = max(nearest[v, u], window_depth[i : i + 2, j : j + 2].max())
        intensity[v, u] = np.mean(looks)
    return intensity, nearest


def centre_depth(window_depth, position):
    """Each centre on the plane through its nearest sample, by the flatter of two slopes."""
    found = np.zeros(position.shape[:2])
    for v, u in np.ndindex(found.shape):
        x, y = position[v, u].astype(float)
        j, i = int(x + 0.5), int(y + 0.5)
        cross = window_depth.astype(float)
        slopes_x = cross[i, j] - cross[i, j - 1], cross[i, j + 1] - cross[i, j]
        slopes_y = cross[i, j] - cross[i - 1, j], cross[i + 1, j] - cross[i, j]
        moved = (x - j) * min(slopes_x, key=abs) + (y - i) * min(slopes_y, key=abs)
        found[v, u] = max(cross[i, j] + moved, 0) if cross[i, j] > 0 else 0
    return found


def inverse_depth(window_depth, supersample, ratio, near_m, far_m):
    """Of each sample of a sensor, in the lens's axes: 0 where it sees nothing."""
    found = np.zeros(window_depth.shape)
    for y, x in np.ndindex(found.shape):
        v, u = y // supersample, x // supersample
        dv, du = ((n % supersample + 0.5) / supersample - 0.5 for n in (y, x))
        z_view_m = 1 / (window_depth[y, x] * (1 / near_m - 1 / far_m) + 1 / far_m)
        if window_depth[y, x] > 0:
            found[y, x] = 1 / (z_view_m * (ratio[v, u] @ [1, du, dv]))
    return found
