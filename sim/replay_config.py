"""Every parameter of the replay of a recorded trajectory in a scene; imports no numpy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from emvs.parameters import ParameterGroup

Positive = Annotated[float, Field(gt=0)]


class ReplayConfig(ParameterGroup):
    """A recorded trajectory instead of the scene's own motion."""

    model_config = ConfigDict(allow_inf_nan=False)

    trajectory: Path | None = None
    """Poses in TUM format, `t_s x y z qx qy qz qw`; None moves the head as the scene says."""

    sha256: str = ""
    """Hash of the file: written by the simulation, and checked where it is given."""

    place: Literal["start", "level", "world"] = "start"
    """Where it goes: `start` puts its first pose onto the scene's; `level` as well, but keeps the
    recording's tilt (its world's z must be up); `world` takes the recorded world for the scene's.
    """

    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Added to the positions afterwards, in the scene's axes, m."""

    heading_deg: float = 0.0
    """Turns the whole way about the vertical through its start, counter-clockwise from above."""

    scale: Positive = 1.0
    """Factor on the recorded positions."""

    start_s: Annotated[float, Field(ge=0)] = 0.0
    """Where to begin, s after the first pose."""

    position_hz: Positive = 10.0
    """Smoothing of positions: -3 dB at this frequency, Hz."""

    rotation_hz: Positive = 10.0
    """Smoothing of rotations: -3 dB at this frequency, Hz."""

    max_gap_s: Positive = 0.05
    """Refuse a longer time without a pose; what lies within a gap is interpolated, not recorded."""

    max_speed_m_s: Positive = 12.0
    """Refuse a faster step between two poses, before scaling."""

    max_rate_rad_s: Positive = 20.0
    """Refuse a faster turn between two poses."""

    hand_eye: Path | None = None
    """What turns the recorded body's poses into camera 0's: JSON or YAML with `T_body_cam`, or
    TUM-VIE's mocap-imu calibration, together with `imu_cam`. None: the poses are camera 0's.
    """

    imu_cam: Path | None = None
    """TUM-VIE's camera calibration, with `T_imu_cam`, see `hand_eye`."""
