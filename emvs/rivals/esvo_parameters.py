"""Parameters of ESVO's mapping: those of its authors' configuration for MVSEC.

Zhou, Gallego, Shen, TRO 2021, and the configuration that they published with their program;
docs/baselines_esvo.md lists both beside ours. No numpy is imported.
"""

from __future__ import annotations

from pydantic import Field

from emvs.parameters import ParameterGroup
from emvs.rivals.parameters import (
    Count,
    MedianPixels,
    NotNegative,
    OddPixels,
    Positive,
)


class Matching(ParameterGroup):
    """Block matching that starts each estimate."""

    width_px: OddPixels = Field(default=15, description="columns of a block, odd, px")
    height_px: OddPixels = Field(default=7, description="rows of a block, odd, px")
    coarse_px: Count = Field(
        default=1,
        description="step of the first search along the row, px; the second takes every pixel",
    )
    least_zncc: float = Field(
        default=0.8,
        ge=-1,
        le=1,
        description="zero-mean normalised cross-correlation that a match needs",
    )


class Refinement(ParameterGroup):
    """The non-linear least squares of one inverse depth; time surfaces count 0..255."""

    width_px: OddPixels = Field(default=15, description="columns of the compared patch, odd, px")
    height_px: OddPixels = Field(default=7, description="rows of the compared patch, odd, px")
    steps: int = Field(
        default=10, ge=0, description="most iterations; 0: as block matching left it"
    )
    dof: float = Field(
        default=2.182,
        gt=2,
        description="degrees of freedom of the residuals' Student t distribution",
    )
    scale: Positive = Field(default=17.277, description="its scale")


class CleanUp(ParameterGroup):
    """Which estimates count: the first two before they are fused, all of them afterwards."""

    most_deviation_px: Positive = Field(
        default=3.4,
        description="largest standard deviation of an estimate, as disparity, px; the published "
        "0.15 / m on the rig of MVSEC",
    )
    most_spread: Positive = Field(
        default=20.0, description="largest scale of a patch's residuals, refitted after refinement"
    )
    least_fusions: int = Field(
        default=1, ge=0, description="how often a pixel's first estimate must have met one like it"
    )


class Regularisation(ParameterGroup):
    """A mean over like neighbours; off, as in the published configuration."""

    radius_px: int = Field(
        default=0,
        ge=0,
        le=50,
        description="half a side of the neighbourhood, px; 0: none; elsewhere 5",
    )
    least_neighbours: int = Field(
        default=8,
        ge=0,
        description="neighbours like it that a pixel needs to stay, itself left out",
    )


class EsvoParameters(ParameterGroup):
    """ESVO's mapping: `ESVO/own-rate` and `ESVO/window`."""

    decay_s: Positive = Field(default=0.03, description="time constant of the time surfaces, s")
    median_px: MedianPixels = Field(default=3, description="median over them, 1 (none), 3 or 5 px")
    blur_sigma_px: NotNegative = Field(
        default=0.0, description="standard deviation of a Gaussian after it, px; 0: none"
    )
    recent_s: Positive = Field(
        default=0.01, description="how long before a map's time an event may have come, s"
    )
    most_events: Count = Field(
        default=1000, description="events that one map looks at, the newest ones"
    )
    rate_hz: Positive = Field(default=20.0, description="maps per second, Hz")
    most_points: Count = Field(
        default=4500,
        description="estimates that ESVO/own-rate fuses, of whole maps, the newest ones",
    )
    matching: Matching = Matching()
    refinement: Refinement = Refinement()
    clean_up: CleanUp = CleanUp()
    regularisation: Regularisation = Regularisation()
