"""Settings of the scoring, without numpy, so that the command line's help stays fast."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from emvs.parameters import ParameterGroup

RankingMetric = Literal[
    "mean_error", "median_error", "rmse", "abs_rel", "aerr_r", "silog", "bad_published"
]


class EvalConfig(ParameterGroup):
    """Which ground truth counts, and which number ranks the methods."""

    min_truth_depth_m: float | None = Field(
        default=None, gt=0, description="Nearer ground truth is left out [m]; unset: no limit."
    )
    max_truth_depth_m: float | None = Field(
        default=None, gt=0, description="Farther ground truth is left out [m]; unset: no limit."
    )
    truth_tolerance_s: float = Field(
        default=0,
        ge=0,
        description="A data set's ground truth this close to a reference view is carried into it "
        "by the poses [s]; 0: only truth of the same time.",
    )
    border_px: int = Field(
        default=0, ge=0, description="Pixels this close to the image border are left out [px]."
    )
    boundary_px: int = Field(
        default=2, ge=1, le=100, description="How far a depth boundary reaches to each side [px]."
    )
    edge_contrast: float = Field(
        default=0.1, gt=0, description="Gradient of log intensity that makes an edge [1/px]."
    )
    ranking_metric: RankingMetric = Field(
        default="mean_error", description="The metric that orders the methods; lower is better."
    )

    @model_validator(mode="after")
    def _limits_in_order(self) -> EvalConfig:
        near_m, far_m = self.truth_limits_m
        if near_m >= far_m:
            raise ValueError(
                f"min_truth_depth_m {near_m:g} must lie below max_truth_depth_m {far_m:g}"
            )
        return self

    @property
    def truth_tolerance_us(self) -> int:
        """How far a data set's ground truth may lie from a reference view, µs."""
        return round(self.truth_tolerance_s * 1e6)

    @property
    def truth_limits_m(self) -> tuple[float, float]:
        """The closed range of ground-truth depths that are scored, m."""
        near_m = 0.0 if self.min_truth_depth_m is None else self.min_truth_depth_m
        far_m = float("inf") if self.max_truth_depth_m is None else self.max_truth_depth_m
        return near_m, far_m
