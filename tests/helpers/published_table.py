"""The published table of MVSEC's indoor flights: DERD-Net, NeurIPS 2025, Tab. 11."""

from __future__ import annotations

from dataclasses import dataclass

RATIOS = {"mean_error": "mean error", "median_error": "median error", "bad_published": "bad-pix"}
"""Metrics that both have, and what the table calls them."""


@dataclass(frozen=True)
class Published:
    """A line of the published table.

    Attributes:
        method: as the table calls it.
        ours: what this project calls the same.
        mean_cm: mean error, cm.
        median_cm: median error, cm.
        bad_percent: bad-pix, %.
        points_m: points of all flights, millions.
    """

    method: str
    ours: str
    mean_cm: float
    median_cm: float
    bad_percent: float
    points_m: float

    def value(self, metric: str) -> float:
        """One of the metrics of `RATIOS`, in the table's unit."""
        fields = {"mean_error": "mean_cm", "median_error": "median_cm"}
        return float(getattr(self, fields.get(metric, "bad_percent")))


TABLE = (
    Published("MC-EMVS Alg. 1 (H)", "Alg1/H", 20.07, 9.53, 1.35, 0.81),
    Published("ESVO", "ESVO/own-rate", 25.00, 10.59, 3.35, 2.04),
    Published("EMVS mono", "EMVS/cam0", 33.78, 14.35, 3.84, 1.27),
    Published("SGM, 1 s", "SGM/window", 35.42, 12.35, 6.39, 14.46),
    Published("GTS, 1 s", "GTS/events", 389.00, 45.43, 38.45, 0.06),
)
H, MONO, SGM = TABLE[0], TABLE[2], TABLE[3]
"""What the ratios are of, and what reports most points."""
