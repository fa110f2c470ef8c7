"""ESVO's inverse depths as Student t distributions: fusion, compatibility and propagation.

Zhou, Gallego, Shen, TRO 2021, section IV: the product of two Student t densities, approximated by
one again. The bulk of an estimate lies within twice its standard deviation, which is
`s sqrt(nu / (nu - 2))`.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_WIDTHS = 2.0  # of 95 percent


@dataclass(frozen=True, eq=False)
class Estimates:
    """Student t distributed inverse depths, of pixels or of points.

    Attributes:
        rho: inverse depth, 1/m; NaN for none.
        scale: its scale, 1/m.
        dof: its degrees of freedom.
        count: int64, how many were fused into it.
        spread: the smallest scale of residuals among those (`Refined.spread`).
    """

    rho: Floats
    scale: Floats
    dof: Floats
    count: NDArray[np.int64]
    spread: Floats

    @classmethod
    def empty(cls, height_px: int, width_px: int) -> Estimates:
        """A map without any."""
        shape = height_px, width_px
        return cls(np.full(shape, np.nan), np.zeros(shape), np.zeros(shape),
                   np.zeros(shape, np.int64), np.zeros(shape))  # fmt: skip

    @property
    def deviation(self) -> Floats:
        """Standard deviation of inverse depth, 1/m."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.scale * np.sqrt(self.dof / (self.dof - 2))


@njit(cache=True)
def deviation_of(scale, dof):
    """Standard deviation of a Student t distribution with more than 2 degrees of freedom."""
    return scale * np.sqrt(dof / (dof - 2))


@njit(cache=True)
def compatible(rho_a, dev_a, rho_b, dev_b):
    """Whether either mean lies within two standard deviations of the other."""
    return abs(rho_a - rho_b) <= _WIDTHS * max(dev_a, dev_b)


@njit(cache=True)
def fuse_two(rho_a, scale_a, dof_a, rho_b, scale_b, dof_b):
    """Mean, scale and degrees of freedom of the fused distribution."""
    dof = min(dof_a, dof_b)
    square_a, square_b = scale_a * scale_a, scale_b * scale_b
    both = square_a + square_b
    rho = (square_a * rho_b + square_b * rho_a) / both
    apart = (rho_a - rho_b) ** 2 / both
    square = (dof + apart) / (dof + 1) * square_a * square_b / both
    return rho, np.sqrt(square), dof + 1


def propagate(
    rays: Floats, origins_m: Floats, rho: Floats, scale: Floats
) -> tuple[Floats, Floats, Floats]:
    """Carries inverse depths into another view, and their scales by the derivative.

    Args:
        rays: (N, 3) `R @ (bearing, 1)` in the new view.
        origins_m: (N, 3) where those rays begin in the new view, m.
        rho: (N,) inverse depths in the old one, 1/m.
        scale: (N,) their scales, 1/m.

    Returns:
        (N, 2) bearings in the new view, (N,) inverse depths there and (N,) their scales; inverse
        depths are NaN behind it.
    """
    points = rays + rho[:, None] * origins_m
    with np.errstate(divide="ignore", invalid="ignore"):
        front = (points[:, 2] > 0) & np.isfinite(rho)
        new = np.where(front, rho / points[:, 2], np.nan)
        slope = np.abs(rays[:, 2]) / points[:, 2] ** 2
        return points[:, :2] / points[:, 2:], new, scale * slope


def fuse_into(
    known: Estimates, uv_px: Floats, rho: Floats, scale: Floats, spread: Floats, dof: float
) -> Estimates:
    """Fuses points into the four pixels around each; `known` stays as it is.

    Where a point is not compatible with what is there, it is left out if it lies behind by more
    than two standard deviations; else it takes the place of what is less sure and fits worse.

    Args:
        known: (H, W) map.
        uv_px: (N, 2) columns and rows.
        rho: (N,) inverse depths, 1/m; NaN for none.
        scale: (N,) their scales, 1/m.
        spread: (N,) scales of their residuals.
        dof: their degrees of freedom, above 2.

    Returns:
        The map with the points.
    """
    fused = Estimates(*(getattr(known, name).copy() for name in Estimates.__dataclass_fields__))
    _fuse(
        uv_px, rho, scale, spread, dof, fused.rho, fused.scale, fused.dof, fused.count, fused.spread
    )
    return fused


@njit(cache=True)
def _fuse(
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
