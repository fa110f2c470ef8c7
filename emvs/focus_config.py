"""Parameters of the extraction by focus."""

from __future__ import annotations

from dataclasses import dataclass

from emvs.dsi import focus_measures
from emvs.errors import InputError

_POSITIVE = (
    "sigma_px", "agreement_px", "agreement_at_px", "ray_px", "support_px", "inside_rise",
    "surface_sigma_px", "surface_px",
)  # fmt: skip


@dataclass(frozen=True)
class FocusConfig:
    """Parameters of the extraction; chosen on simulated data by `eval.study_extraction`.

    Lengths in px are pixels of the view, disparities those of the rig's baseline: both keep their
    meaning for other sensors, baselines and depth planes (`docs/extraction.md`).

    Attributes:
        measure: focus measure, by its name in `emvs.dsi.focus_measures.MEASURES`.
        sigma_px: scale of the focus measure, px.
        agreement_px: disagreement between cameras that divides the reliability by e, px of
            disparity, where that is `agreement_at_px`; elsewhere it grows with its square root.
        agreement_at_px: disparity to which `agreement_px` refers, px.
        ray_px: distance from the plain maximum that divides the reliability by e, px of disparity.
        support_radius_px: half the square of neighbours that are asked, px.
        support_px: how far a neighbour's depth may be off to count as support, px of disparity.
        inside_radius_px: half the square in which a pixel looks for its own surface, px.
        inside_rise: relative rise of the votes, from the pixel to the middle of its own surface,
            at which it rather lies beyond that surface's edge.
        surface_sigma_px: scale of the window in which a plane is fitted to the disparities, px.
        surface_px: how far a neighbour's disparity may be off to take part in that, px.
        threshold_kernel_px: window of the candidates' adaptive threshold, px, odd, at least 3.
        threshold_c: by how much of 255 the fused maximum must exceed its neighbours' mean.
    """

    measure: str = "variance"
    sigma_px: float = 2.5
    agreement_px: float = 0.4
    agreement_at_px: float = 10.0
    ray_px: float = 3.0
    support_radius_px: int = 5
    support_px: float = 1.0
    inside_radius_px: int = 8
    inside_rise: float = 0.16
    surface_sigma_px: float = 4.0
    surface_px: float = 0.5
    threshold_kernel_px: int = 5
    threshold_c: float = 2.0

    def __post_init__(self) -> None:
        """Refuses what cannot work."""
        focus_measures.measure(self.measure)
        for name in _POSITIVE:
            if not getattr(self, name) > 0:
                raise InputError(f"{name} is {getattr(self, name)}: must be above 0")
        for name in ("support_radius_px", "inside_radius_px"):
            if getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name)}: must be at least 1")
        if self.threshold_kernel_px < 3 or self.threshold_kernel_px % 2 == 0:
            raise InputError(
                f"threshold_kernel_px is {self.threshold_kernel_px}: must be odd and at least 3"
            )
