"""The compiled loops of ESVO: block matching, refinement, fusion of Student t distributions."""

# mypy: disable-error-code="no-any-return, no-untyped-call, no-untyped-def"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

# Variance of a block on a surface of 0..255 below which it is flat.
_FLAT = 1.0
_CONVERGED = 1e-4  # px of disparity
_SPREAD_CONVERGED = 0.05  # of its square
_LEAST_SPREAD = 1e-3  # of surfaces that count 0..255
_WIDTHS = 2.0  # of 95 percent


@njit(cache=True, nogil=True)
def _zncc(left, right, u, v, d, half_x, half_y):
    """ZNCC of two blocks, -2 where one is flat or leaves the picture."""
    width = left.shape[1]
    if u - d - half_x < 0 or u - d + half_x >= width:
        return -2.0
    n = (2 * half_x + 1) * (2 * half_y + 1)
    a, b, aa, bb, ab = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(v - half_y, v + half_y + 1):
        for i in range(u - half_x, u + half_x + 1):
            p, q = np.float64(left[j, i]), np.float64(right[j, i - d])
            a += p
            b += q
            aa += p * p
            bb += q * q
            ab += p * q
    aa -= a * a / n
    bb -= b * b / n
    if aa < _FLAT * n or bb < _FLAT * n:
        return -2.0
    return (ab - a * b / n) / np.sqrt(aa * bb)


@njit(cache=True, nogil=True)
def search(start, stop, left, right, pixels, low, high, half_x, half_y, coarse, out_px, out_zncc):
    """Fills the best disparity and its ZNCC of pixels `start` to `stop` of the list.

    It looks at every `coarse` disparity, then around the best.
    """
    height, width = left.shape
    for k in range(start, stop):
        u, v = pixels[k, 0], pixels[k, 1]
        out_px[k], out_zncc[k] = np.nan, -2.0
        if u < half_x or v < half_y or u >= width - half_x or v >= height - half_y:
            continue
        best, where = -2.0, -1
        for d in range(low, high + 1, coarse):
            value = _zncc(left, right, u, v, d, half_x, half_y)
            if value > best:
                best, where = value, d
        if where < 0:
            continue
        middle = where
        for d in range(max(low, middle - coarse + 1), min(high, middle + coarse - 1) + 1):
            value = _zncc(left, right, u, v, d, half_x, half_y)
            if value > best:
                best, where = value, d
        out_px[k], out_zncc[k] = where, best


@njit(cache=True, inline="always")
def _at(image, x, y):
    """Bilinear value at (x, y), and its derivatives by x and y."""
    i, j = int(x), int(y)
    fx, fy = x - i, y - j
    p, q = np.float64(image[j, i]), np.float64(image[j, i + 1])
    r, s = np.float64(image[j + 1, i]), np.float64(image[j + 1, i + 1])
    top, bottom = p + fx * (q - p), r + fx * (s - r)
    return top + fy * (bottom - top), (1 - fy) * (q - p) + fy * (s - r), bottom - top


@njit(cache=True, nogil=True)
def _differences(left, right, a, b, camera, rho, half_x, half_y, out, slope):
    """Fills a patch's residuals and their derivatives by rho; False where it leaves a picture."""
    height, width = left.shape
    f, cx, cy, baseline = camera
    x, y, z = a[0] + rho * b[0], a[1] + rho * b[1], a[2] + rho * b[2]
    if not z > 0:
        return False
    u, v = f * x / z + cx, f * y / z + cy
    w = u - f * baseline * rho / z
    du, dv = f * (b[0] * z - x * b[2]) / (z * z), f * (b[1] * z - y * b[2]) / (z * z)
    dw = du - f * baseline * a[2] / (z * z)
    if not (half_x <= u < width - 1 - half_x and half_x <= w < width - 1 - half_x):
        return False
    if not half_y <= v < height - 1 - half_y:
        return False
    n = 0
    for j in range(-half_y, half_y + 1):
        for i in range(-half_x, half_x + 1):
            p, px, py = _at(left, u + i, v + j)
            q, qx, qy = _at(right, w + i, v + j)
            out[n], slope[n] = p - q, px * du + py * dv - qx * dw - qy * dv
            n += 1
    return True


@njit(cache=True, nogil=True)
def _sums(residual, slope, dof, scale):
    """Cost of a patch, its half gradient, and the weighted square of the derivatives."""
    cost, jr, jwj = 0.0, 0.0, 0.0
    for k in range(len(residual)):
        r, d = residual[k], slope[k]
        t = r * r / (scale * scale)
        weight = (dof + 1) / (dof + t)
        cost += (dof + 1) * np.log1p(t / dof)
        jr += weight * d * r
        jwj += weight * d * d
    return cost, jr, jwj


@njit(cache=True, nogil=True)
def _spread(residual, dof, scale):
    """Scale of a Student t distribution that fits the residuals, by its fixed point."""
    square = scale * scale
    while square > _LEAST_SPREAD * _LEAST_SPREAD:
        new = 0.0
        for r in residual:
            new += (dof + 1) * r * r / (dof + r * r / square)
        new /= len(residual)
        if abs(new - square) <= _SPREAD_CONVERGED * square:
            return np.sqrt(new)
        square = new
    return _LEAST_SPREAD


@njit(cache=True, nogil=True)
def _information(residual, slope, dof, spread):
    """Sum of squared derivatives of the weighted residuals `sqrt(w(r)) r`."""
    total = 0.0
    for k in range(len(residual)):
        t = residual[k] * residual[k] / (spread * spread)
        total += (dof + 1) / (dof + t) * (dof / (dof + t) * slope[k]) ** 2
    return total


@njit(cache=True, nogil=True)
def refine_all(
    start, stop, left, right, a, b, camera, rho_start, half_x, half_y, steps, dof, scale, out
):  # fmt: skip
    """Fills rho, its scale and the spread of events `start` to `stop`."""
    n = (2 * half_x + 1) * (2 * half_y + 1)
    here, there = np.empty((2, n)), np.empty((2, n))
    for k in range(start, stop):
        rho, damping = rho_start[k], 1e-3
        if not _differences(left, right, a[k], b[k], camera, rho, half_x, half_y, here[0], here[1]):
            continue
        cost, jr, jwj = _sums(here[0], here[1], dof, scale)
        for _ in range(steps):
            if jwj <= 0 or damping > 1e6:
                break
            change = -jr / (jwj * (1 + damping))
            if rho + change > 0 and _differences(
                left, right, a[k], b[k], camera, rho + change, half_x, half_y, there[0], there[1]
            ):
                new = _sums(there[0], there[1], dof, scale)
            else:
                new = (np.inf, 0.0, 0.0)
            if new[0] < cost:
                rho += change
                here, there = there, here
                cost, jr, jwj = new
                damping = max(damping / 10, 1e-9)
                if abs(change) * camera[0] * camera[3] < _CONVERGED:
                    break
            else:
                damping = max(damping, 1e-4) * 10
        spread = _spread(here[0], dof, scale)
        information = _information(here[0], here[1], dof, spread)
        if information > 0:
            out[k, 0], out[k, 1], out[k, 2] = rho, scale / np.sqrt(information), spread


@njit(cache=True, nogil=True)
def smooth(start, stop, rho, deviation, radius, least, out):
    """Fills rows `start` to `stop` with the mean over compatible neighbours."""
    height, width = rho.shape
    for v in range(start, stop):
        for u in range(width):
            out[v, u] = np.nan
            if np.isnan(rho[v, u]):
                continue
            total, weights, count = 0.0, 0.0, 0
            for j in range(max(0, v - radius), min(height, v + radius + 1)):
                for i in range(max(0, u - radius), min(width, u + radius + 1)):
                    if np.isnan(rho[j, i]):
                        continue
                    if compatible(rho[v, u], deviation[v, u], rho[j, i], deviation[j, i]):
                        weight = 1 / deviation[j, i] ** 2
                        total += weight * rho[j, i]
                        weights += weight
                        count += 1
            if count > least:
                out[v, u] = total / weights


@njit(cache=True, nogil=True)
def deviation_of(scale, dof):
    """Standard deviation of a Student t distribution with more than 2 degrees of freedom."""
    return scale * np.sqrt(dof / (dof - 2))


@njit(cache=True, nogil=True)
def compatible(rho_a, dev_a, rho_b, dev_b):
    """Whether either mean lies within two standard deviations of the other."""
    return abs(rho_a - rho_b) <= _WIDTHS * max(dev_a, dev_b)


@njit(cache=True, nogil=True)
def fuse_two(rho_a, scale_a, dof_a, rho_b, scale_b, dof_b):
    """Mean, scale and degrees of freedom of the fused distribution."""
    dof = min(dof_a, dof_b)
    square_a, square_b = scale_a * scale_a, scale_b * scale_b
    both = square_a + square_b
    rho = (square_a * rho_b + square_b * rho_a) / both
    apart = (rho_a - rho_b) ** 2 / both
    square = (dof + apart) / (dof + 1) * square_a * square_b / both
    return rho, np.sqrt(square), dof + 1


@njit(cache=True, nogil=True)
def fuse(
    uv_px, rho, scale, spread, dof, out_rho, out_scale, out_dof, out_count, out_spread
):  # fmt: skip
    """In the order of the points; two of them may meet in one pixel."""
    height, width = out_rho.shape
    for k in range(len(rho)):
        u, v = uv_px[k, 0], uv_px[k, 1]
        if not (rho[k] > 0 and scale[k] > 0 and -1 < u < width and -1 < v < height):
            continue
        new = deviation_of(scale[k], dof)
        for j in range(int(np.floor(v)), int(np.floor(v)) + 2):
            for i in range(int(np.floor(u)), int(np.floor(u)) + 2):
                if i < 0 or j < 0 or i >= width or j >= height:
                    continue
                old = deviation_of(out_scale[j, i], out_dof[j, i]) if out_count[j, i] else np.inf
                if out_count[j, i] and compatible(out_rho[j, i], old, rho[k], new):
                    fused = fuse_two(
                        out_rho[j, i], out_scale[j, i], out_dof[j, i], rho[k], scale[k], dof
                    )
                    out_rho[j, i], out_scale[j, i], out_dof[j, i] = fused
                    out_count[j, i] += 1
                    out_spread[j, i] = min(out_spread[j, i], spread[k])
                    continue
                behind = out_count[j, i] and out_rho[j, i] - _WIDTHS * old > rho[k]
                better = new < old and (not out_count[j, i] or spread[k] < out_spread[j, i])
                if better and not behind:
                    out_rho[j, i], out_scale[j, i], out_dof[j, i] = rho[k], scale[k], dof
                    out_count[j, i], out_spread[j, i] = 1, spread[k]
