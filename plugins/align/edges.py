"""Edges of a picture to a fraction of a pixel, and which of them an event belongs to."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import KDTree

Array = NDArray[np.float64]
_SMOOTH_PX = 0.7
_DARK = 0.02  # of full scale: added before the logarithm, as the sensor's own is
_LEAST_SLOPE = 0.04
"""Least change of log intensity per pixel that counts as an edge."""
_BESIDE_PX = 1.0
_CLEAR = 0.5
"""Of a point's motion: less of it across an edge makes no events to speak of."""


class Edges(NamedTuple):
    """Edges of one picture.

    Attributes:
        uv_px: (E, 2) places, to a fraction of a pixel.
        normal: (E, 2) unit vectors towards the bright side.
        slope: (E,) change of log intensity per pixel along it.
        light: (E,) grey level on the edge, 0 to 1.
        width_px: of the picture.
        tree: finds the nearest place. A table of the nearest edge of every pixel would not do: of
            two edges as far away it takes the upper one, and events seem to lie lower than they do.
    """

    uv_px: Array
    normal: Array
    slope: Array
    light: Array
    width_px: int
    tree: Any


class Matches(NamedTuple):
    """Points of events beside the edges that they belong to.

    Attributes:
        points: (M,) their numbers.
        edges: (M,) numbers of edges.
        off_px: (M,) signed distance from the edge towards its bright side, px.
    """

    points: NDArray[np.int64]
    edges: NDArray[np.int64]
    off_px: Array


def find_edges(image: NDArray[np.float32]) -> Edges:
    """Finds where log intensity changes most along its gradient; events come at such places.

    `image` (H, W) is grey levels, 0 to 255, as blurred as pixels of the event camera's size see it:
    blur moves edges of log intensity towards their dark side.
    """
    log = np.log(image.astype(np.float64) / 255 + _DARK)
    smooth = cv2.GaussianBlur(log, (0, 0), _SMOOTH_PX)
    by_row, by_column = np.gradient(smooth)
    slope = np.hypot(by_column, by_row)
    rows, columns = np.nonzero(slope > _LEAST_SLOPE)
    inside = (rows > 1) & (columns > 1) & (rows < len(log) - 2) & (columns < log.shape[1] - 2)
    rows, columns = rows[inside], columns[inside]
    here = slope[rows, columns]
    normal = np.stack([by_column[rows, columns], by_row[rows, columns]], -1) / here[:, None]
    places = np.stack([columns, rows], -1).astype(np.float64)
    behind, ahead = (_at(slope, places + side * normal) for side in (-1, 1))
    peak = (here >= behind) & (here > ahead)
    bend = behind - 2 * here + ahead
    shift = 0.5 * (behind - ahead) / np.where(bend < 0, bend, -1.0)
    moved = places + np.clip(shift, -0.5, 0.5)[:, None] * normal
    exact = np.asarray(moved[peak], np.float64)
    light = np.exp(_at(np.asarray(smooth, np.float64), exact)) - _DARK
    return Edges(exact, normal[peak], here[peak], light, log.shape[1], KDTree(exact))


def _at(values: Array, uv_px: Array) -> Array:
    found: Array = map_coordinates(values, uv_px.T[::-1], order=1, mode="nearest")
    return found


def match(
    edges: Edges, uv_px: Array, moving_px: Array, brighter: NDArray[np.bool_], gate_px: float
) -> Matches:
    """Gives every point the nearest edge that would make such an event.

    Args:
        edges: of the picture.
        uv_px: (N, 2) where the points of the events are in it, NaN where not.
        moving_px: (N, 2) how each of them moves there, in any unit of time.
        brighter: (N,) polarity.
        gate_px: points further from the edge belong to none.
    """
    known = np.flatnonzero(np.isfinite(uv_px).all(-1))
    reach_px = np.hypot(gate_px, _BESIDE_PX)
    far_px, nearest = edges.tree.query(uv_px[known], distance_upper_bound=reach_px)
    near = np.isfinite(far_px)
    points, found = known[near], nearest[near]
    away = uv_px[points] - edges.uv_px[found]
    normal = edges.normal[found]
    off_px = (away * normal).sum(-1)
    beside = np.abs(away[:, 0] * normal[:, 1] - away[:, 1] * normal[:, 0])
    across = (moving_px[points] * normal).sum(-1)
    clear = np.abs(across) > _CLEAR * np.linalg.norm(moving_px[points], axis=-1)
    # What moves towards an edge's bright side leaves the dark side's pixels behind it.
    expected = (across < 0) == brighter[points]
    good = (np.abs(off_px) <= gate_px) & (beside <= _BESIDE_PX) & clear & expected
    return Matches(points[good], found[good], off_px[good])
