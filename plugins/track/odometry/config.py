"""Parameters of the odometry, beside what follows from sensor and rig; imports no numpy."""

from __future__ import annotations

from pydantic import Field

from eventsweep.emvs.config import Positive
from eventsweep.emvs.parameters import ParameterGroup


class TrackConfig(ParameterGroup):
    """How poses are found and maps made; every field has a default that works."""

    rate_hz: Positive = Field(default=100.0, le=10_000, description="fewest poses per second, Hz")
    map_rate_hz: Positive = Field(default=5.0, le=1000, description="fewest maps per second, Hz")
    map_s: Positive = Field(default=0.4, description="longest window of a map, s")
    maps: int = Field(default=8, ge=1, le=1000, description="maps whose points are tracked")
    planes: int | None = Field(
        default=None, ge=2, le=100_000,
        description="depth planes of a map; by default one per pixel of disparity, 40 to 100",
    )  # fmt: skip
    map_events: int | None = Field(
        default=None, ge=1000,
        description="most events of each camera that make a map; by default 170 per column of the "
        "image, at least 60,000",
    )  # fmt: skip
    min_depth_m: Positive | None = Field(
        default=None, description="nearest depth, m; by default the recording's own, else 0.2"
    )
    max_depth_m: Positive | None = Field(
        default=None, description="farthest depth, m; by default the recording's own, else 5"
    )
    half_resolution: bool = Field(
        default=False,
        description="track images of half as many columns and rows: for sensors of a megapixel",
    )
    gyroscope: bool = Field(
        default=False, description="use the rates of turn in the recording's imu.csv"
    )
    threads: int = Field(default=0, ge=0, description="threads of the kernels; 0: all")
