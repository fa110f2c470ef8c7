"""What can be perturbed in a recording, and by how much."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

NotNegative = Annotated[FiniteFloat, Field(ge=0)]


class Perturbation(BaseModel):
    """What is perturbed and by how much; by default nothing. Amounts are standard deviations."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    pose_white_mm: NotNegative = Field(0, description="position noise of every pose, mm per axis")
    pose_white_deg: NotNegative = Field(0, description="rotation noise of every pose, deg per axis")
    pose_walk_mm: NotNegative = Field(0, description="random walk of position, mm per sqrt(s)")
    pose_walk_deg: NotNegative = Field(0, description="random walk of rotation, deg per sqrt(s)")
    drift_percent: NotNegative = Field(
        0, description="odometry: error of each step's length, % of the way, slowly varying"
    )
    drift_yaw_deg_s: NotNegative = Field(
        0, description="odometry: rate of turn about the vertical, deg/s, constant"
    )
    pose_rate_hz: NotNegative = Field(0, description="poses are thinned to this rate; 0: all stay")
    pose_delay_ms: FiniteFloat = Field(0, description="poses come this late on the events' clock")
    camera_delay_ms: FiniteFloat = Field(0, description="events of camera 1 are stamped this late")
    focal_percent: FiniteFloat = Field(0, description="focal lengths are overestimated, %")
    centre_px: FiniteFloat = Field(0, description="principal points are shifted right, px")
    stereo_yaw_deg: FiniteFloat = Field(0, description="yaw error of camera 1, deg")
    stereo_pitch_deg: FiniteFloat = Field(0, description="pitch error of camera 1, deg")
    baseline_percent: FiniteFloat = Field(0, description="the baseline is overestimated, %", gt=-99)
    keep_events: float = Field(1, gt=0, le=1, description="share of events that is kept")
