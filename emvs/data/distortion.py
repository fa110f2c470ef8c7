"""Lens distortion on normalised coordinates: each model forwards and backwards.

`DISTORT` maps a bearing (x/z, y/z) to where an ideal sensor of focal length 1 sees it; `UNDISTORT`
is its inverse, by Newton's method, NaN where the model folds over and no physical ray exists.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

_Lens = Callable[[NDArray[np.float64], tuple[float, ...]], NDArray[np.float64]]
TERMS = {"pinhole": (0,), "radtan": (4, 5), "kb4": (4,)}
_ITERATIONS = 100


def _distort_radtan(bearing: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.float64]:
    """Brown-Conrady, as OpenCV's `projectPoints` with (k1, k2, p1, p2[, k3])."""
    k1, k2, p1, p2, k3 = (*terms, 0.0)[:5]
    x, y = bearing[..., 0], bearing[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def _undistort_radtan(sensor: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.float64]:
    """Newton's method on the forward model, numeric Jacobian; starts at the distorted position."""
    bearing = sensor.copy()
    step = 1e-7
    step_x, step_y = np.array([step, 0]), np.array([0, step])
    for _ in range(_ITERATIONS):
        wrong = _distort_radtan(bearing, terms) - sensor
        dx = (_distort_radtan(bearing + step_x, terms) - sensor - wrong) / step
        dy = (_distort_radtan(bearing + step_y, terms) - sensor - wrong) / step
        determinant = dx[..., 0] * dy[..., 1] - dy[..., 0] * dx[..., 1]
        move_x = (wrong[..., 0] * dy[..., 1] - wrong[..., 1] * dy[..., 0]) / determinant
        move_y = (wrong[..., 1] * dx[..., 0] - wrong[..., 0] * dx[..., 1]) / determinant
        move = np.stack([move_x, move_y], axis=-1)
        bearing = bearing - move
        if np.nanmax(np.abs(move), initial=0.0) < 1e-14:
            break
    # Past the turning point of the radial curve the model folds over: no physical ray is there.
    return np.where(_grows_outward(bearing, terms)[..., None], bearing, np.nan)


def _grows_outward(bearing: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.bool_]:
    k1, k2, _, _, k3 = (*terms, 0.0)[:5]
    r2 = (bearing**2).sum(axis=-1)
    inner = np.linspace(0, 1, 33)[:, *(None,) * r2.ndim] * r2
    grows: NDArray[np.bool_] = (1 + inner * (3 * k1 + inner * (5 * k2 + inner * 7 * k3)) > 0).all(
        axis=0
    )
    return grows


def _distort_kb4(bearing: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.float64]:
    """Kannala and Brandt (PAMI 2006) with four terms, as OpenCV's `fisheye`."""
    r = np.hypot(bearing[..., 0], bearing[..., 1])
    theta = np.arctan(r)
    scale = np.where(r > 1e-12, _kb4_radius(theta, terms) / np.maximum(r, 1e-12), 1.0)
    return bearing * scale[..., None]


def _undistort_kb4(sensor: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.float64]:
    """Newton's method on the angle from the optical axis."""
    k1, k2, k3, k4 = terms
    radius = np.hypot(sensor[..., 0], sensor[..., 1])
    theta = np.minimum(radius, np.pi / 2 - 1e-3)
    for _ in range(_ITERATIONS):
        t2 = theta * theta
        slope = 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
        move = (_kb4_radius(theta, terms) - radius) / slope
        theta = theta - move
        if np.nanmax(np.abs(move), initial=0.0) < 1e-15:
            break
    theta = np.where((theta >= 0) & (theta < np.pi / 2) & (slope > 0), theta, np.nan)
    scale = np.where(radius > 1e-12, np.tan(theta) / np.maximum(radius, 1e-12), 1.0)
    return sensor * scale[..., None]


def _kb4_radius(theta: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.float64]:
    k1, k2, k3, k4 = terms
    t2 = theta * theta
    return theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))


def _same(bearing: NDArray[np.float64], _terms: tuple[float, ...]) -> NDArray[np.float64]:
    return bearing


DISTORT: dict[str, _Lens] = {"pinhole": _same, "radtan": _distort_radtan, "kb4": _distort_kb4}
UNDISTORT: dict[str, _Lens] = {"pinhole": _same, "radtan": _undistort_radtan, "kb4": _undistort_kb4}
