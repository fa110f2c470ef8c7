"""Odometry for users of the library: all that `eventsweep track` does, but for its folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets import opened
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.plugins.track.odometry import recorded
from eventsweep.plugins.track.odometry.config import TrackConfig
from eventsweep.plugins.track.odometry.online import OnlineMap
from eventsweep.plugins.track.odometry.recorded import Tracked


def track(
    recording: Recording | str | Path,
    config: TrackConfig | None = None,
    *,
    first_map: DepthMap | None = None,
    T_world_body: NDArray[np.float64] | None = None,
    on_map: Callable[[OnlineMap], None] | None = None,
    progress: Progress = silent,
) -> Tracked:
    """Finds the poses of a recording from its events and calibration alone.

    Args:
        recording: what `open_recording` gave, a recording of your own, or the path of one; its
            poses are not read.
        config: rates, sizes of maps, depth range.
        first_map: a depth map of what is seen first, in whose world the poses are; needed with one
            camera.
        T_world_body: (4, 4) where the first pose lies; by default the origin.
        on_map: called with every map that is made.
        progress: called with the name of the stage, how much is done and how much there is.

    Returns:
        `trajectory`, the status of every pose, and when and why the status changed.

    Raises:
        InputError: no events, one camera without a first map, or no place to begin from.
    """
    return recorded.track(
        opened(recording), config, first_map=first_map, T_world_body=T_world_body,
        on_map=on_map, progress=progress,
    )  # fmt: skip
