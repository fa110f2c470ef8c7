"""The plane-filling baseline: semi-dense depth made dense, a plane per triangle of its points.

Inverse depth is linear in pixels where a surface is a plane, so interpolating it over the Delaunay
triangulation puts a plane through each three neighbours; outside of all triangles the nearest point
counts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.maps.folder import read_map

_FEWEST = 3


def filled(depth_m: NDArray[np.floating], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(H, W) depth at every pixel, m.

    Args:
        depth_m: (H, W) z-depth, m.
        mask: (H, W) where it is known.

    Raises:
        InputError: fewer than three points, or all on one line.
    """
    places = np.argwhere(mask).astype(np.float64)
    if len(places) < _FEWEST or np.linalg.matrix_rank(places - places[0]) < 2:
        raise InputError(f"{len(places)} points of depth span no triangle: map more events")
    inverse = 1 / depth_m[mask].astype(np.float64)
    every = np.argwhere(np.ones_like(mask))
    found = LinearNDInterpolator(places, inverse)(every)
    outside = np.isnan(found)
    if outside.any():
        found[outside] = NearestNDInterpolator(places, inverse)(every[outside])
    return np.asarray((1 / found).reshape(mask.shape), np.float32)


def fill_map(folder: Path, method: str, out: Path) -> None:
    """Writes the filled depth of each window of a map as a prediction, `TIME.npz`."""
    out.mkdir(parents=True, exist_ok=True)
    for window in read_map(folder).windows:
        found = window.depth_map(method)
        depth_m = filled(found.depth_m, found.mask)
        np.savez_compressed(out / f"{window.info.t_ref_us}.npz", depth_m=depth_m)
