"""ESVO's filter: inverse depths as Student t distributions, fused, propagated and regularised.

Zhou, Gallego, Shen, TRO 2021, section IV: the product of two Student t densities, approximated by
one again. The bulk of an estimate lies within twice its standard deviation, which is
`s sqrt(nu / (nu - 2))`. The regularised map is a mean over compatible neighbours, weighted by their
variances, that leaves depth edges alone; the authors' configuration for MVSEC leaves it out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.baselines.esvo_kernels import fuse, smooth
from eventsweep.emvs.config import CleanUp, Regularisation

Float64s = NDArray[np.float64]


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

    rho: Float64s
    scale: Float64s
    dof: Float64s
    count: NDArray[np.int64]
    spread: Float64s

    @classmethod
    def empty(cls, height_px: int, width_px: int) -> Estimates:
        """A map without any."""
        shape = height_px, width_px
        return cls(np.full(shape, np.nan), np.zeros(shape), np.zeros(shape),
                   np.zeros(shape, np.int64), np.zeros(shape))  # fmt: skip

    @property
    def deviation(self) -> Float64s:
        """Standard deviation of inverse depth, 1/m."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.scale * np.sqrt(self.dof / (self.dof - 2))


def propagate(
    rays: Float64s, origins_m: Float64s, rho: Float64s, scale: Float64s
) -> tuple[Float64s, Float64s, Float64s]:
    """Carries (N,) inverse depths into another view, and their scales by the derivative.

    There the (N, 3) rays `R @ (bearing, 1)` begin at (N, 3) `origins_m`.

    Returns:
        (N, 2) bearings, (N,) inverse depths, NaN behind the view, and (N,) their scales.
    """
    points = rays + rho[:, None] * origins_m
    with np.errstate(divide="ignore", invalid="ignore"):
        front = (points[:, 2] > 0) & np.isfinite(rho)
        new = np.where(front, rho / points[:, 2], np.nan)
        slope = np.abs(rays[:, 2]) / points[:, 2] ** 2
        return points[:, :2] / points[:, 2:], new, scale * slope


def fuse_into(
    known: Estimates, uv_px: Float64s, rho: Float64s, scale: Float64s, spread: Float64s, dof: float
) -> Estimates:
    """Fuses (N,) points into the four pixels around each; `known` stays as it is.

    Where a point is not compatible with what is there, it is left out if it lies behind by more
    than two standard deviations; else it takes the place of what is less sure and fits worse.
    """
    fused = Estimates(*(getattr(known, name).copy() for name in Estimates.__dataclass_fields__))
    fuse(
        uv_px, rho, scale, spread, dof, fused.rho, fused.scale, fused.dof, fused.count, fused.spread
    )
    return fused


def regularised(
    known: Estimates, clean_up: CleanUp, settings: Regularisation, most_deviation: float
) -> Float64s:
    """Cleans a fused map: (H, W) float64 inverse depths, 1/m; NaN for none.

    Estimates of more than `most_deviation`, 1/m, are left out.
    """
    deviation = known.deviation
    with np.errstate(invalid="ignore"):
        sure = (known.count > clean_up.least_fusions) & (deviation <= most_deviation)
    rho: Float64s = np.where(sure, known.rho, np.nan)
    if not settings.radius_px:
        return rho
    out = np.empty(rho.shape)
    smooth(rho, deviation, settings.radius_px, settings.least_neighbours, out)
    return out
