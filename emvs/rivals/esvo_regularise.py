"""ESVO's last step: lonely or vague estimates go, the others are averaged with their like.

Zhou, Gallego, Shen, TRO 2021, section IV: a mean over compatible neighbours, weighted by their
variances, that leaves depth edges alone. Their configuration for MVSEC leaves the mean out.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit, prange

import emvs.threads  # noqa: F401
from emvs.rivals.esvo_parameters import CleanUp, Regularisation
from emvs.rivals.esvo_student_t import Estimates, Floats, compatible


def regularised(
    known: Estimates, clean_up: CleanUp, settings: Regularisation, most_deviation: float
) -> Floats:
    """Cleans a fused map.

    Args:
        known: (H, W) map.
        clean_up: which estimates stay.
        settings: of the mean over neighbours.
        most_deviation: standard deviation beyond which an estimate is left out, 1/m.

    Returns:
        (H, W) float64 inverse depths, 1/m; NaN for none.
    """
    deviation = known.deviation
    with np.errstate(invalid="ignore"):
        sure = (known.count > clean_up.least_fusions) & (deviation <= most_deviation)
    rho: Floats = np.where(sure, known.rho, np.nan)
    if not settings.radius_px:
        return rho
    out = np.empty(rho.shape)
    _smooth(rho, deviation, settings.radius_px, settings.least_neighbours, out)
    return out


@njit(cache=True, parallel=True)
def _smooth(rho, deviation, radius, least, out):
    """Fills the mean over compatible neighbours; a thread owns its rows."""
    height, width = rho.shape
    for v in prange(height):
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
