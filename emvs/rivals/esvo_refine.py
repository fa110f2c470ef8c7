"""ESVO's refinement: one inverse depth per event, by the difference of time-surface patches.

Zhou, Gallego, Shen, TRO 2021, section IV: an event of time t - eps, with inverse depth rho in its
own view, is carried to time t by the poses and seen by both cameras there. The residuals are
differences of the two time surfaces over a patch, Student t distributed; Levenberg-Marquardt with
the weights of that distribution minimises them. Its scale, carried through the derivative of the
weighted residuals, is the scale of rho: `s_rho^2 = s_r^2 / |J|^2`. As in the authors' program the
weights of that derivative take the distribution's scale from the patch itself, which is also what
says how well the patch fits.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

import emvs.threads  # noqa: F401
from emvs.rivals.esvo_parameters import Refinement

Image = NDArray[np.float32]
Floats = NDArray[np.float64]

_CONVERGED = 1e-4  # px of disparity
_SPREAD_CONVERGED = 0.05  # of its square
_LEAST_SPREAD = 1e-3  # of surfaces that count 0..255


@dataclass(frozen=True, eq=False)
class Lines:
    """Where each event's viewing ray runs in the rectified view at time t: `a + rho b`.

    Attributes:
        a: (N, 3) direction of the event's ray, of depth 1 in its own view.
        b: (N, 3) its origin, m.
        focal_px: of both views.
        centre_px: principal point (column, row) of both views.
        baseline_m: distance of the two.
    """

    a: Floats
    b: Floats
    focal_px: float
    centre_px: tuple[float, float]
    baseline_m: float


@dataclass(frozen=True, eq=False)
class Refined:
    """Inverse depths in the events' own views.

    Attributes:
        rho: (N,) inverse depth, 1/m; NaN where a patch leaves the picture or is flat.
        scale: (N,) scale of its Student t distribution, 1/m.
        spread: (N,) scale of the residuals, fitted to the patch; surfaces count 0..255.
    """

    rho: Floats
    scale: Floats
    spread: Floats


def refine(left: Image, right: Image, lines: Lines, rho: Floats, settings: Refinement) -> Refined:
    """Refines inverse depths.

    Args:
        left: (H, W) float32 time surface, 0..255.
        right: (H, W) float32, rows aligned with it.
        lines: (N,) events.
        rho: (N,) where to start, 1/m.
        settings: of the refinement.
    """
    out = np.full((len(rho), 3), np.nan)
    camera = (lines.focal_px, lines.centre_px[0], lines.centre_px[1], lines.baseline_m)
    half = settings.width_px // 2, settings.height_px // 2
    _refine_all(
        left, right, lines.a, lines.b, camera, np.asarray(rho, np.float64), half[0], half[1],
        settings.steps, settings.dof, settings.scale, out,
    )  # fmt: skip
    return Refined(out[:, 0], out[:, 1], out[:, 2])


@njit(cache=True, inline="always")
def _at(image, x, y):
    """Bilinear value at (x, y), and its derivatives by x and y."""
    i, j = int(x), int(y)
    fx, fy = x - i, y - j
    p, q = np.float64(image[j, i]), np.float64(image[j, i + 1])
    r, s = np.float64(image[j + 1, i]), np.float64(image[j + 1, i + 1])
    top, bottom = p + fx * (q - p), r + fx * (s - r)
    return top + fy * (bottom - top), (1 - fy) * (q - p) + fy * (s - r), bottom - top


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def _information(residual, slope, dof, spread):
    """Sum of squared derivatives of the weighted residuals `sqrt(w(r)) r`."""
    total = 0.0
    for k in range(len(residual)):
        t = residual[k] * residual[k] / (spread * spread)
        total += (dof + 1) / (dof + t) * (dof / (dof + t) * slope[k]) ** 2
    return total


@njit(cache=True, parallel=True)
def _refine_all(left, right, a, b, camera, start, half_x, half_y, steps, dof, scale, out):
    """Fills rho, its scale and the spread; a thread owns the rows of its events."""
    n = (2 * half_x + 1) * (2 * half_y + 1)
    for k in prange(len(start)):
        here, there = np.empty((2, n)), np.empty((2, n))
        rho, damping = start[k], 1e-3
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
