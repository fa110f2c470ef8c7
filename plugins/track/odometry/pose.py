"""What a tracker says: a pose at a time, and what it comes from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from eventsweep.plugins.track.odometry.motion import Motion, smoothed_motions
from eventsweep.plugins.track.odometry.registration.fit import Fit

Matrix = NDArray[np.float64]


class Status(Enum):
    """What a tracker does at the moment."""

    STARTING = "starting"
    TRACKING = "tracking"
    UNCERTAIN = "uncertain"
    STILL = "still"
    COASTING = "coasting"
    LOST = "lost"


@dataclass(frozen=True, eq=False)
class Pose:
    """One pose of a tracker.

    Attributes:
        t_us: the time that it belongs to, µs, on the events' clock: the middle of those that it is
            made of. Maps need this time. What events show was there a little earlier.
        T_world_body: (4, 4).
        twist: (6,) velocity and turn of the body in its own frame, m/s and rad/s.
        status: what it comes from.
        fit: how well events and map agree.
        covariance: (6, 6) of errors of position, m, and turn, rad, along the world's axes, from the
            first pose on; see `drift`.
        belief: the motion that the filter found, its own time and certainty; None where no filter
            led to it: at the beginning, without events that count, or just found again.
    """

    t_us: int
    T_world_body: Matrix
    twist: Matrix
    status: Status
    fit: Fit
    covariance: Matrix
    belief: Motion | None = None


def smoothed(poses: Sequence[Pose]) -> list[Pose]:
    """Poses as those after them say, too, as far as one filter led from each to the next."""
    better = smoothed_motions([pose.belief for pose in poses])
    return [
        pose if here is None
        else replace(pose, T_world_body=here.T_world_body, twist=here.twist)
        for pose, here in zip(poses, better, strict=True)
    ]  # fmt: skip
