"""Ground truth at a reference time: our sequences' own, or what DSEC and MVSEC bring along.

Both offer the same two functions. A data set has truth when its lidar or its disparity was taken,
which is rarely when a map's reference view is; truth near that time is carried over by the poses.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.warp import move_depth


class TruthRecording(Recording, Protocol):
    """A recording with depth at some times, in its cameras' undistorted views."""

    def truth_times_us(self, camera: int) -> NDArray[np.int64]:
        """(T,) times with ground truth, µs; there may be none."""

    def truth_view_depth_m(self, camera: int, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in `rig.cameras[camera].undistorted()` at one of them, m, else NaN."""


def nearest_truth_us(recording: TruthRecording, t_ref_us: int, tolerance_us: int = 0) -> int:
    """The time of ground truth of camera 0 that is nearest to a reference time, µs.

    It may lie `tolerance_us` from it; at 0 the stamps must be equal.
    """
    times_us = recording.truth_times_us(0)
    if getattr(recording, "truth_any_time", False) and times_us[0] <= t_ref_us <= times_us[-1]:
        return t_ref_us
    if not len(times_us):
        raise InputError(
            f"{recording.name}: a recording without ground truth; there is nothing to score against"
        )
    nearest_us = int(times_us[np.argmin(np.abs(times_us - t_ref_us))])
    off_us = nearest_us - t_ref_us
    if abs(off_us) > tolerance_us:
        raise InputError(
            f"{recording.name}: no ground truth within {tolerance_us} µs of the reference time "
            f"{t_ref_us} µs, the nearest is {off_us:+d} µs away ({nearest_us} µs): map with "
            "reference_s there, or raise truth_tolerance_s"
        )
    return nearest_us


def truth_at(
    recording: TruthRecording, t_ref_us: int, tolerance_us: int = 0
) -> NDArray[np.float32]:
    """Ground truth in camera 0's undistorted view at a reference time.

    Truth of another time within the tolerance is carried over point by point: the world stands
    still, the poses say where both views are, and of several surfaces on one pixel the nearest
    stays.

    Returns:
        (H, W) z-depth, m; not finite where unknown.

    Raises:
        InputError: none is that near, or the poses do not cover it.
    """
    t_us = nearest_truth_us(recording, t_ref_us, tolerance_us)
    depth_m = recording.truth_view_depth_m(0, t_us)
    if t_us == t_ref_us:
        return depth_m
    T_world_cam = recording.trajectory.at([t_ref_us, t_us]) @ recording.rig.T_body_cam[0]
    view = recording.rig.cameras[0].undistorted()
    return move_depth(depth_m, view, view, se3.inverse(T_world_cam[0]) @ T_world_cam[1])
