"""ESVO's last step: lonely or vague estimates go, the others are averaged with their like.

Zhou, Gallego, Shen, TRO 2021, section IV: a mean over compatible neighbours, weighted by their
variances, that leaves depth edges alone. Their configuration for MVSEC leaves the mean out.
"""

from __future__ import annotations

import numpy as np

from emvs.rivals.esvo_kernels import smooth
from emvs.rivals.esvo_parameters import CleanUp, Regularisation
from emvs.rivals.esvo_student_t import Estimates, Floats


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
    smooth(rho, deviation, settings.radius_px, settings.least_neighbours, out)
    return out
