"""The slow twin of `geometry.nearest`: every disc is looked at, by the formula."""

import numpy as np


def nearest_disc(queries, points, normals=None, radius_m=None):
    """(Q,) distances of places from the nearest of all discs, and (Q,) which one."""
    found = []
    for query in queries:
        apart = query - points
        if normals is None:
            distance = np.sqrt(np.sum(apart**2, axis=1))
        else:
            along = np.sum(apart * normals.astype(np.float64), axis=1)
            beside = np.sqrt(np.maximum(np.sum(apart**2, axis=1) - along**2, 0))
            distance = np.hypot(along, np.maximum(beside - radius_m.astype(np.float64), 0))
        found.append((distance.min(), int(np.argmin(distance))))
    distances, numbers = zip(*found, strict=True)
    return np.array(distances), np.array(numbers)
