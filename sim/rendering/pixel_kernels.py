"""Compiled loops over pixels: displacement, resampling through a lens, samples to pixels."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

SAME_SURFACE = np.float32(0.02)
"""Window depths of neighbouring samples of one surface differ by less than this share."""
# Rec. 709 luma of linear RGB; the last bit makes white exactly 1.
LUMA = (0.2126, 0.7152, 0.0722)


# Without NaN and signed zeros the row's maximum vectorises, and the loop runs at 2.5 ns a pixel.
@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def squared_displacement(
    depth_m: NDArray[np.float32],
    focal_px: NDArray[np.float64],
    centre_px: NDArray[np.float64],
    T_b_a: NDArray[np.float64],
    rows: NDArray[np.float64],
) -> None:
    """Fills `rows` (H,) with the largest squared motion, px², of each row's pixels.

    Args:
        depth_m: (H, W) z-depth in camera pose a; inf for directions without a surface.
        focal_px: (2,) focal lengths.
        centre_px: (2,) principal point.
        T_b_a: (4, 4) from camera pose a to camera pose b.
        rows: out, (H,); inf where a point leaves the half-space before camera pose b.
    """
    height, width = depth_m.shape
    for i in range(height):
        y = (i - centre_px[1]) / focal_px[1]
        at_x = T_b_a[0, 1] * y + T_b_a[0, 2]
        at_y = T_b_a[1, 1] * y + T_b_a[1, 2]
        at_z = T_b_a[2, 1] * y + T_b_a[2, 2]
        largest = 0.0
        nearest = np.inf
        for j in range(width):
            x = (j - centre_px[0]) / focal_px[0]
            rho = 1.0 / depth_m[i, j]
            z_b = T_b_a[2, 0] * x + at_z + T_b_a[2, 3] * rho
            per_z = 1.0 / z_b
            du = focal_px[0] * ((T_b_a[0, 0] * x + at_x + T_b_a[0, 3] * rho) * per_z - x)
            dv = focal_px[1] * ((T_b_a[1, 0] * x + at_y + T_b_a[1, 3] * rho) * per_z - y)
            largest = max(largest, du * du + dv * dv)
            nearest = min(nearest, z_b)
        rows[i] = largest if nearest > 0.0 else np.inf


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def squared_displacement_lens(
    depth_m: NDArray[np.float32],
    bearing: NDArray[np.float32],
    magnification_px: NDArray[np.float32],
    T_b_a: NDArray[np.float64],
    rows: NDArray[np.float64],
) -> None:
    """Fills `rows` (H,) with the largest squared motion, px², of each row's pixels, for any lens.

    The change of bearing is exact; the lens turns it into pixels by its derivative at the pixel,
    which for half a pixel is right to 1 % (tested).

    Args:
        depth_m: (H, W) z-depth in camera pose a; inf for directions without a surface.
        bearing: (H, W, 2) bearing of each pixel.
        magnification_px: (H, W, 2, 2) derivative of pixel position by bearing.
        T_b_a: (4, 4) from camera pose a to camera pose b.
        rows: out, (H,); inf where a point leaves the half-space before camera pose b.
    """
    height, width = depth_m.shape
    for i in range(height):
        largest = 0.0
        nearest = np.inf
        for j in range(width):
            x, y = np.float64(bearing[i, j, 0]), np.float64(bearing[i, j, 1])
            rho = 1.0 / depth_m[i, j]
            z_b = T_b_a[2, 0] * x + T_b_a[2, 1] * y + T_b_a[2, 2] + T_b_a[2, 3] * rho
            x_b = T_b_a[0, 0] * x + T_b_a[0, 1] * y + T_b_a[0, 2] + T_b_a[0, 3] * rho
            y_b = T_b_a[1, 0] * x + T_b_a[1, 1] * y + T_b_a[1, 2] + T_b_a[1, 3] * rho
            dx, dy = x_b / z_b - x, y_b / z_b - y
            du = magnification_px[i, j, 0, 0] * dx + magnification_px[i, j, 0, 1] * dy
            dv = magnification_px[i, j, 1, 0] * dx + magnification_px[i, j, 1, 1] * dy
            largest = max(largest, du * du + dv * dv)
            nearest = min(nearest, z_b)
        rows[i] = largest if nearest > 0.0 else np.inf


@numba.njit(cache=True, nogil=True)
def sample_offsets(supersample: int) -> NDArray[np.float32]:
    """(S,) where samples lie in a pixel, from its centre, px: a division each is too dear."""
    offset = np.empty(supersample, np.float32)
    for k in range(supersample):
        offset[k] = (k + 0.5) / supersample - 0.5
    return offset


@numba.njit(cache=True, nogil=True, inline="always")
def sample_at(
    luma: NDArray[np.float32],
    window_depth: NDArray[np.float32],
    position: NDArray[np.float32],
    step: NDArray[np.float32],
    u: int,
    v: int,
    du: np.float32,
    dv: np.float32,
) -> tuple[np.float32, np.float32]:
    """Bilinear light of a source picture, and the nearest of the four samples that took part.

    Args:
        luma: (Hs, Ws) light of the samples, bottom row first.
        window_depth: (Hs, Ws) their window depth, 1 near and 0 far.
        position: `LensMap.position`.
        step: `LensMap.step`.
        u: the sensor pixel's column.
        v: its row.
        du: place in the pixel, px to the right of its centre.
        dv: px below it.
    """
    x = position[v, u, 0] + step[v, u, 0, 0] * du + step[v, u, 0, 1] * dv
    y = position[v, u, 1] + step[v, u, 1, 0] * du + step[v, u, 1, 1] * dv
    # 32 bits take one instruction; without a sign there is no negative index to look for.
    j, i, one = np.uint32(np.int32(x)), np.uint32(np.int32(y)), np.uint32(1)
    a, b = x - np.float32(np.int32(x)), y - np.float32(np.int32(y))
    below = luma[i, j] + a * (luma[i, j + one] - luma[i, j])
    above = luma[i + one, j] + a * (luma[i + one, j + one] - luma[i + one, j])
    near = max(window_depth[i, j], window_depth[i, j + one])
    near = max(near, window_depth[i + one, j], window_depth[i + one, j + one])
    return below + b * (above - below), near


@numba.njit(cache=True, nogil=True)
def resample(
    luma: NDArray[np.float32],
    window_depth: NDArray[np.float32],
    position: NDArray[np.float32],
    step: NDArray[np.float32],
    supersample: int,
    intensity: NDArray[np.float32],
    nearest: NDArray[np.float32],
) -> None:
    """Fills `intensity` with each pixel's mean light and `nearest` with its nearest sample.

    A pixel is the mean of supersample² positions spread evenly over it, each interpolated
    bilinearly; `nearest` is the largest window depth of all samples that took part.

    Args:
        luma: (Hs, Ws) light of the samples, bottom row first.
        window_depth: (Hs, Ws) window depth of the samples, 1 near and 0 far.
        position: `LensMap.position`.
        step: `LensMap.step`.
        supersample: positions per pixel and axis.
        intensity: out, (H, W).
        nearest: out, (H, W).
    """
    height, width = intensity.shape
    share, offset = np.float32(1.0 / (supersample * supersample)), sample_offsets(supersample)
    for v in range(height):
        for u in range(width):
            total = np.float32(0.0)
            near = np.float32(0.0)
            for k in range(supersample):
                dv = offset[k]
                for m in range(supersample):
                    du = offset[m]
                    light, depth = sample_at(luma, window_depth, position, step, u, v, du, dv)
                    total += light
                    near = max(near, depth)
            intensity[v, u] = total * share
            nearest[v, u] = near


@numba.njit(cache=True, nogil=True, inline="always")
def sample_of_one_surface(
    luma: NDArray[np.float32],
    window_depth: NDArray[np.float32],
    position: NDArray[np.float32],
    step: NDArray[np.float32],
    u: int,
    v: int,
    du: np.float32,
    dv: np.float32,
) -> tuple[np.float32, np.float32]:
    """Light and window depth of a source picture: bilinear, but never of two surfaces at once.

    Where the four samples around the place lie on more than one surface, that of the nearest
    sample. Arguments as in `sample_at`.
    """
    x = position[v, u, 0] + step[v, u, 0, 0] * du + step[v, u, 0, 1] * dv
    y = position[v, u, 1] + step[v, u, 1, 0] * du + step[v, u, 1, 1] * dv
    j, i, one = np.uint32(np.int32(x)), np.uint32(np.int32(y)), np.uint32(1)
    a, b = x - np.float32(np.int32(x)), y - np.float32(np.int32(y))
    half = np.float32(0.5)
    d00, d01 = window_depth[i, j], window_depth[i, j + one]
    d10, d11 = window_depth[i + one, j], window_depth[i + one, j + one]
    near, far = max(max(d00, d01), max(d10, d11)), min(min(d00, d01), min(d10, d11))
    if near - far > SAME_SURFACE * near:
        p, q = i + np.uint32(b >= half), j + np.uint32(a >= half)
        return luma[p, q], window_depth[p, q]
    below = luma[i, j] + a * (luma[i, j + one] - luma[i, j])
    above = luma[i + one, j] + a * (luma[i + one, j + one] - luma[i + one, j])
    d_below, d_above = d00 + a * (d01 - d00), d10 + a * (d11 - d10)
    return below + b * (above - below), d_below + b * (d_above - d_below)


@numba.njit(cache=True, nogil=True)
def resampled(
    luma: NDArray[np.float32],
    window_depth: NDArray[np.float32],
    position: NDArray[np.float32],
    step: NDArray[np.float32],
    supersample: int,
    light: NDArray[np.float32],
    depth: NDArray[np.float32],
) -> None:
    """Fills the samples of a sensor behind a lens.

    Args:
        luma: (Hs, Ws) light of the source picture, bottom row first.
        window_depth: (Hs, Ws) its window depth, 1 near and 0 far.
        position: `LensMap.position`.
        step: `LensMap.step`.
        supersample: S, samples per pixel and axis.
        light: out, (S H, S W), top row first.
        depth: out, (S H, S W), window depth.
    """
    height, width = position.shape[:2]
    offset = sample_offsets(supersample)
    for v in range(height):
        for k in range(supersample):
            y = v * supersample + k
            for u in range(width):
                for m in range(supersample):
                    x = u * supersample + m
                    light[y, x], depth[y, x] = sample_of_one_surface(
                        luma, window_depth, position, step, u, v, offset[m], offset[k]
                    )


@numba.njit(cache=True, nogil=True)
def centre_depth(
    window_depth: NDArray[np.float32],
    position: NDArray[np.float32],
    found: NDArray[np.float32],
) -> None:
    """Fills `found` (H, W) with the window depth at each pixel's centre.

    Window depth is affine in the pinhole picture on every plane, so the plane through the sample
    nearest to the centre is followed there: exact on planes, and never a mean of two surfaces. Of
    the two slopes around that sample along each axis the flatter counts, which is that of its own
    surface beside a depth edge. An edge lies wrong by half a sample at most.

    Args:
        window_depth: (Hs, Ws) window depth of the samples, 1 near and 0 far.
        position: `LensMap.position`.
        found: out, (H, W).
    """
    height, width = found.shape
    for v in range(height):
        for u in range(width):
            x, y = position[v, u, 0], position[v, u, 1]
            j, i = int(x + np.float32(0.5)), int(y + np.float32(0.5))
            here = window_depth[i, j]
            before, behind = here - window_depth[i, j - 1], window_depth[i, j + 1] - here
            along = before if abs(before) <= abs(behind) else behind
            before, behind = here - window_depth[i - 1, j], window_depth[i + 1, j] - here
            across = before if abs(before) <= abs(behind) else behind
            moved = here + (x - np.float32(j)) * along + (y - np.float32(i)) * across
            found[v, u] = max(moved, np.float32(0.0)) if here > 0.0 else np.float32(0.0)


@numba.njit(cache=True, nogil=True)
def average(
    rgb: NDArray[np.uint8] | NDArray[np.float32],
    window_depth: NDArray[np.float32],
    supersample: int,
    intensity: NDArray[np.float32],
    nearest: NDArray[np.float32],
    full_scale: float = 255.0,
) -> None:
    """Fills `intensity` and `nearest` (H, W), top row first, from samples, bottom row first.

    Args:
        rgb: (sH, sW, 3) colour of the samples.
        window_depth: (sH, sW) window depth of the samples, 1 near and 0 far.
        supersample: s, samples per pixel and axis.
        intensity: out, (H, W), mean luma, 1 at full scale.
        nearest: out, (H, W), largest window depth.
        full_scale: the colour value that means 1.
    """
    height, width = intensity.shape
    scale = 1.0 / (full_scale * supersample * supersample)
    for row in range(height):
        first = (height - 1 - row) * supersample
        for column in range(width):
            red = 0
            green = 0
            blue = 0
            near = np.float32(0.0)
            for i in range(first, first + supersample):
                for j in range(column * supersample, (column + 1) * supersample):
                    red += rgb[i, j, 0]
                    green += rgb[i, j, 1]
                    blue += rgb[i, j, 2]
                    near = max(near, window_depth[i, j])
            luma = LUMA[0] * red + LUMA[1] * green + LUMA[2] * blue
            intensity[row, column] = luma * scale
            nearest[row, column] = near


@numba.njit(cache=True, nogil=True)
def luma(
    rgb: NDArray[np.uint8] | NDArray[np.float32],
    full_scale: float,
    out: NDArray[np.float32],
    upside_down: bool = False,
) -> None:
    """Fills `out` (H, W) with the luma of `rgb` (H, W, 3), 1 at `full_scale`.

    With `upside_down` the last row of `rgb` becomes the first of `out`.
    """
    red, green, blue = (
        np.float32(LUMA[0] / full_scale),
        np.float32(LUMA[1] / full_scale),
        np.float32(LUMA[2] / full_scale),
    )
    height, width = out.shape
    flat = rgb.reshape(height, 3 * width)
    for i in range(height):
        row, filled = flat[height - 1 - i] if upside_down else flat[i], out[i]
        for j in range(width):
            # Without a sign there is no negative index to look for, and the loop vectorises.
            k = np.uint64(3 * j)
            g, b = k + np.uint64(1), k + np.uint64(2)
            filled[j] = red * row[k] + green * row[g] + blue * row[b]
