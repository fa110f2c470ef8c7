"""ESVO's refinement: one inverse depth per event, by the difference of time-surface patches.

Zhou, Gallego, Shen, TRO 2021, section IV: an event of time t - eps, with inverse depth rho in its
own view, is carried to time t by the poses and seen by both cameras there. The residuals are
differences of the two time surfaces over a patch, Student t distributed; Levenberg-Marquardt with
the weights of that distribution minimises them. Its scale, carried through the derivative, is the
scale of rho: `s_rho^2 = s_r^2 / |J|^2`.
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
        rho: (N,) inverse depth, 1/m; NaN where a patch leaves the picture or nothing converges.
        scale: (N,) scale of its Student t distribution, 1/m.
        rms: (N,) root mean square of the patch's residuals, surfaces counting 0..255.
    """

    rho: Floats
    scale: Floats
    rms: Floats


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
def _sums(left, right, a, b, camera, rho, half_x, half_y, dof, scale):
    """Weighted cost, JWr, JWJ, JJ and mean square of a patch; the cost is inf outside."""
    height, width = left.shape
    f, cx, cy, baseline = camera
    x, y, z = a[0] + rho * b[0], a[1] + rho * b[1], a[2] + rho * b[2]
    if not z > 0:
        return np.inf, 0.0, 0.0, 0.0, 0.0
    u, v = f * x / z + cx, f * y / z + cy
    w = u - f * baseline * rho / z
    du, dv = f * (b[0] * z - x * b[2]) / (z * z), f * (b[1] * z - y * b[2]) / (z * z)
    dw = du - f * baseline * a[2] / (z * z)
    if not (half_x <= u < width - 1 - half_x and half_x <= w < width - 1 - half_x):
        return np.inf, 0.0, 0.0, 0.0, 0.0
    if not half_y <= v < height - 1 - half_y:
        return np.inf, 0.0, 0.0, 0.0, 0.0
    cost, jr, jwj, jj, squares = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(-half_y, half_y + 1):
        for i in range(-half_x, half_x + 1):
            p, px, py = _at(left, u + i, v + j)
            q, qx, qy = _at(right, w + i, v + j)
            r = p - q
            d = px * du + py * dv - qx * dw - qy * dv
            t = r * r / (scale * scale)
            weight = (dof + 1) / (dof + t)
            cost += (dof + 1) * np.log1p(t / dof)
            jr += weight * d * r
            jwj += weight * d * d
            jj += d * d
            squares += r * r
    n = (2 * half_x + 1) * (2 * half_y + 1)
    return cost, jr, jwj, jj, squares / n


@njit(cache=True, parallel=True)
def _refine_all(left, right, a, b, camera, start, half_x, half_y, steps, dof, scale, out):
    """Fills rho, its scale and the rms; a thread owns the rows of its events."""
    for k in prange(len(start)):
        rho, damping = start[k], 1e-3
        cost, jr, jwj, jj, square = _sums(
            left, right, a[k], b[k], camera, rho, half_x, half_y, dof, scale
        )
        if not cost < np.inf:
            continue
        for _ in range(steps):
            if jwj <= 0:
                break
            change = -jr / (jwj * (1 + damping))
            new = _sums(left, right, a[k], b[k], camera, rho + change, half_x, half_y, dof, scale)
            if new[0] < cost and rho + change > 0:
                rho += change
                cost, jr, jwj, jj, square = new
                damping = max(damping / 10, 1e-9)
                if abs(change) * camera[0] * camera[3] < _CONVERGED:
                    break
            else:
                damping = max(damping, 1e-4) * 10
                if damping > 1e6:
                    break
        if jj > 0:
            out[k, 0], out[k, 1], out[k, 2] = rho, scale / np.sqrt(jj), np.sqrt(square)
