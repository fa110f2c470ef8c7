"""Compiled loops of `views`: facets into a buffer of inverse depth, a picture looked up in another.

A buffer holds inverse depth, 1/m: below 0 where nothing is known, 0 at infinity.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

UNKNOWN, OUTSIDE, OCCLUDED, SEEN = 0, 85, 170, 255
"""What a mask says of a pixel: without depth, not in the picture, hidden there, seen."""
_LARGEST_PX = 64.0
_SLACK = 1e-6


@numba.njit(cache=True, nogil=True)
def slopes(rho: NDArray[np.float64], same: float, out: NDArray[np.float64]) -> None:
    """Fills `out` (H, W, 2) with the change of inverse depth per column and row on one surface.

    Of the steps to both neighbours the smaller counts, and none that crosses a discontinuity: a
    step larger than the share `same` of inverse depth that the opposite step does not repeat.
    """
    height, width = rho.shape
    for y in range(height):
        for x in range(width):
            out[y, x] = 0.0
            if rho[y, x] >= 0.0:
                out[y, x, 0] = _slope(
                    rho[y, x - 1] if x > 0 else -1.0, rho[y, x],
                    rho[y, x + 1] if x + 1 < width else -1.0, same,
                )  # fmt: skip
                out[y, x, 1] = _slope(
                    rho[y - 1, x] if y > 0 else -1.0, rho[y, x],
                    rho[y + 1, x] if y + 1 < height else -1.0, same,
                )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _slope(before: float, here: float, behind: float, same: float) -> float:
    back = here - before if before >= 0.0 else np.nan
    ahead = behind - here if behind >= 0.0 else np.nan
    if not abs(back - ahead) <= same * here:  # no plane goes through all three
        back = back if abs(back) <= same * here else np.nan
        ahead = ahead if abs(ahead) <= same * here else np.nan
    if np.isnan(back) and np.isnan(ahead):
        return 0.0
    if np.isnan(back) or np.isnan(ahead):
        return ahead if np.isnan(back) else back
    if back * ahead < 0.0:
        return 0.0
    return back if abs(back) < abs(ahead) else ahead


@numba.njit(cache=True, nogil=True)
def draw(uv_px: NDArray[np.float64], rho: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Draws facets of four corners; the nearest stays.

    Args:
        uv_px: (N, 4, 2) corners in the order of their outline, NaN where one has no place.
        rho: (N, 4) inverse depth of the corners, 1/m.
        out: (H, W), in and out.
    """
    height, width = out.shape
    for n in range(len(uv_px)):
        u, v = uv_px[n, :, 0], uv_px[n, :, 1]
        left, right, top, bottom = u.min(), u.max(), v.min(), v.max()
        if not (right - left <= _LARGEST_PX and bottom - top <= _LARGEST_PX):
            continue  # NaN, or so near that one pixel would fill the view
        first_x, last_x = max(0, int(np.ceil(left))), min(width - 1, int(np.floor(right)))
        first_y, last_y = max(0, int(np.ceil(top))), min(height - 1, int(np.floor(bottom)))
        for half in range(2):
            b, c = 1 + half, 2 + half
            ux, uy, vx, vy = u[b] - u[0], v[b] - v[0], u[c] - u[0], v[c] - v[0]
            area = ux * vy - uy * vx
            if area == 0.0:
                continue
            for y in range(first_y, last_y + 1):
                for x in range(first_x, last_x + 1):
                    px, py = x - u[0], y - v[0]
                    s, t = (px * vy - py * vx) / area, (ux * py - uy * px) / area
                    if s >= -_SLACK and t >= -_SLACK and s + t <= 1.0 + _SLACK:
                        w = rho[n, 0] + s * (rho[n, b] - rho[n, 0]) + t * (rho[n, c] - rho[n, 0])
                        out[y, x] = max(out[y, x], w)


@numba.njit(cache=True, nogil=True)
def look_up(
    uv_px: NDArray[np.float64],
    rho: NDArray[np.float64],
    seen_rho: NDArray[np.float64],
    picture: NDArray[np.float32],
    same: float,
    value: NDArray[np.float32],
    mask: NDArray[np.uint8],
) -> None:
    """Fetches what a picture shows at places of surface points, where nothing hides them.

    Args:
        uv_px: (N, 2) places in the picture, NaN where there is none.
        rho: (N,) inverse depth of the points in the picture's camera; below 0 where unknown.
        seen_rho: (H, W) inverse depth that this camera sees.
        picture: (H, W).
        same: share of inverse depth within which a surface is the same.
        value: out, (N,), 0 where nothing is seen.
        mask: out, (N,), `UNKNOWN`, `OUTSIDE`, `OCCLUDED` or `SEEN`.
    """
    height, width = picture.shape
    for n in range(len(rho)):
        value[n] = 0.0
        if rho[n] < 0.0:
            mask[n] = UNKNOWN
            continue
        u, v = uv_px[n, 0], uv_px[n, 1]
        if not (0.0 <= u <= width - 1 and 0.0 <= v <= height - 1):
            mask[n] = OUTSIDE
            continue
        x, y = min(int(u), width - 2), min(int(v), height - 2)
        total, known, nearest = 0.0, 0.0, 0.0
        for dy in range(2):
            for dx in range(2):
                share = (1.0 - abs(u - x - dx)) * (1.0 - abs(v - y - dy))
                total += share * picture[y + dy, x + dx]
                if seen_rho[y + dy, x + dx] >= 0.0:
                    known += share
                    nearest += share * seen_rho[y + dy, x + dx]
        if known > 0.0 and nearest / known > rho[n] * (1.0 + same) + 1e-9:
            mask[n] = OCCLUDED
            continue
        mask[n] = SEEN
        value[n] = total
