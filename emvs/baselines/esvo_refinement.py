"""ESVO's refinement: one inverse depth per event, by the difference of time-surface patches.

Zhou, Gallego, Shen, TRO 2021, section IV: an event of time t - eps, with inverse depth rho in its
own view, is carried to time t by the poses and seen by both cameras there. The residuals are
differences of the two time surfaces over a patch, Student t distributed; Levenberg-Marquardt with
the weights of that distribution minimises them. Its scale, carried through the derivative of the
weighted residuals, is the scale of rho: `s_rho^2 = s_r^2 / |J|^2`. As in the authors' program the
weights of that derivative take the distribution's scale from the patch itself, which is also what
says how well the patch fits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.baselines.esvo_kernels import refine_all
from eventsweep.emvs.config import Refinement

Image = NDArray[np.float32]
Float64s = NDArray[np.float64]


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

    a: Float64s
    b: Float64s
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

    rho: Float64s
    scale: Float64s
    spread: Float64s


def refine(left: Image, right: Image, lines: Lines, rho: Float64s, settings: Refinement) -> Refined:
    """Refines the inverse depths `rho` of (N,) events, on row-aligned time surfaces of 0..255."""
    out = np.full((len(rho), 3), np.nan)
    camera = (lines.focal_px, lines.centre_px[0], lines.centre_px[1], lines.baseline_m)
    half = settings.width_px // 2, settings.height_px // 2
    refine_all(
        left, right, lines.a, lines.b, camera, np.asarray(rho, np.float64), half[0], half[1],
        settings.steps, settings.dof, settings.scale, out,
    )  # fmt: skip
    return Refined(out[:, 0], out[:, 1], out[:, 2])
