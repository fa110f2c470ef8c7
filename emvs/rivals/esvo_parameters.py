"""The settings of ESVO's mapping; values are those that its authors published where they did.

Those are the ones of the authors' configuration for MVSEC; docs/rivals_esvo.md lists them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from emvs.rivals.time_surface import DECAY_S, MEDIAN_PX


@dataclass(frozen=True)
class Matching:
    """Block matching that starts each estimate.

    Attributes:
        width_px: columns of a block, odd.
        height_px: rows of a block, odd.
        coarse_px: step of the first search along the row, px; the second goes pixel by pixel.
        least_zncc: zero-mean normalised cross-correlation that a match must reach, -1..1.
    """

    width_px: int = 15
    height_px: int = 7
    coarse_px: int = 2
    least_zncc: float = 0.8


@dataclass(frozen=True)
class Refinement:
    """The non-linear least squares of one inverse depth; surfaces count 0..255.

    Attributes:
        width_px: columns of the compared patch, odd.
        height_px: rows of the compared patch, odd.
        steps: most iterations.
        dof: degrees of freedom of the Student t distribution of residuals.
        scale: its scale.
        most_rms: root mean square of a patch's residuals beyond which an estimate is dropped.
    """

    width_px: int = 15
    height_px: int = 7
    steps: int = 10
    dof: float = 2.182
    scale: float = 17.277
    most_rms: float = 20.0


@dataclass(frozen=True)
class Regularisation:
    """Clean-up of the fused map.

    Attributes:
        most_deviation_px: largest standard deviation of an estimate, as disparity, px; the
            published 0.15 / m on the rig of MVSEC.
        least_count: how many estimates a pixel needs that were fused into one.
        radius_px: half a side of the square that counts as neighbourhood.
        least_neighbours: compatible neighbours that a pixel needs to stay.
    """

    most_deviation_px: float = 3.4
    least_count: int = 1
    radius_px: int = 5
    least_neighbours: int = 8


@dataclass(frozen=True)
class EsvoParameters:
    """Parameters of the whole mapping.

    Attributes:
        decay_s: time constant of the time surfaces, s.
        median_px: median over them, px.
        blur_sigma_px: standard deviation of the Gaussian after it, px.
        recent_s: how long before a map's time an event may have come, s.
        most_events: events that are looked at for one map, the newest ones.
        rate_hz: maps per second, Hz.
        maps: how many of the last maps `ESVO/own-rate` fuses.
        matching: of blocks.
        refinement: of inverse depths.
        regularisation: of the fused map.
    """

    decay_s: float = DECAY_S
    median_px: int = MEDIAN_PX
    blur_sigma_px: float = 0.0
    recent_s: float = 0.01
    most_events: int = 1000
    rate_hz: float = 20.0
    maps: int = 20
    matching: Matching = field(default_factory=Matching)
    refinement: Refinement = field(default_factory=Refinement)
    regularisation: Regularisation = field(default_factory=Regularisation)
