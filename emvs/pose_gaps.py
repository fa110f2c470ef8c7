"""Where a trajectory lacks poses: interpolating over a long gap would invent the motion."""

from __future__ import annotations

import numpy as np

from emvs.config import MapperConfig
from emvs.errors import InputError
from emvs.geometry.trajectory import Trajectory

_USUAL_STEPS, _ALWAYS_ALLOWED_US = 10, 50_000


def longest_gap_us(trajectory: Trajectory, config: MapperConfig) -> int:
    """How long two poses may lie apart: as configured, else 10 median steps and at least 50 ms."""
    if config.max_pose_gap_s is not None:
        return round(config.max_pose_gap_s * 1e6)
    if len(trajectory) < 2:
        return _ALWAYS_ALLOWED_US
    return max(_ALWAYS_ALLOWED_US, round(_USUAL_STEPS * float(np.median(np.diff(trajectory.t_us)))))


def check_poses(trajectory: Trajectory, t0_us: int, t1_us: int, config: MapperConfig) -> None:
    """Refuses a window in which poses are missing.

    Args:
        trajectory: poses that cover the window.
        t0_us: begin, included.
        t1_us: end, excluded.
        config: `max_pose_gap_s`.

    Raises:
        InputError: two neighbouring poses too far apart; says where and how far.
    """
    first = max(int(np.searchsorted(trajectory.t_us, t0_us, side="right")) - 1, 0)
    last = int(np.searchsorted(trajectory.t_us, t1_us - 1, side="left")) + 1
    times = trajectory.t_us[first:last]
    if len(times) < 2:
        return
    steps = np.diff(times)
    k, limit_us = int(steps.argmax()), longest_gap_us(trajectory, config)
    if steps[k] > limit_us:
        raise InputError(
            f"no pose for {steps[k] / 1e6:.6g} s ({times[k]}..{times[k + 1]} µs) in the window: "
            f"at most {limit_us / 1e6:g} s are interpolated; choose another window, or set "
            "max_pose_gap_s"
        )
