"""Scores of poses that were found from events, and depth maps on them as estimates to score."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.maps.folder import StoredMap, StoredWindow
from eventsweep.eval.config import TrajectoryConfig
from eventsweep.eval.found_poses import TRACK, method_on_own_poses
from eventsweep.eval.results.table import POOLED, tidy
from eventsweep.eval.scoring.method_scores import Score
from eventsweep.eval.scoring.metrics import NAN
from eventsweep.eval.scoring.pairing import Estimate
from eventsweep.eval.scoring.trajectories.metrics import metrics_of, steps_of_config
from eventsweep.eval.scoring.trajectories.score import score_poses

if TYPE_CHECKING:
    import pandas as pd

_COVERED = "time_covered"


def pose_rows(
    case: str, truth: Trajectory, found: Trajectory | str
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The rows of poses that were found, or of their absence, and what to know about them.

    Args:
        case: its name.
        truth: `T_world_body`.
        found: poses of the same body in a world of their own, or why there are none.
    """
    config = TrajectoryConfig()
    try:
        if isinstance(found, str):
            raise InputError(found)
        scored = score_poses(truth, found, config)
        scores, notes = scored.scores, scored.notes
    except InputError as error:  # too few poses to be scored are a failure of the tracker
        scores, notes = _of_nothing(config), (str(error),)
    rows = (
        {"case": case, "window": POOLED, "method": TRACK, **score._asdict()} for score in scores
    )
    return tidy(rows), notes


def _of_nothing(config: TrajectoryConfig) -> tuple[Score, ...]:
    """The scores where there are no poses: no time is covered, all else is undefined."""
    return tuple(
        Score(one.name, 0.0 if one.name == _COVERED else NAN, one.unit, one.direction)
        for one in metrics_of(steps_of_config(config))
    )


def maps_on_own_poses(stored: StoredMap, window: StoredWindow) -> dict[str, DepthMap]:
    """The depth maps on found poses of a window's view, by method; empty where there are none.

    They lie where the window's own maps do: the two worlds differ, the view is the same.
    """
    # By name, too: shorter and longer windows may have one reference time.
    own = {_view_of(one): one for one in stored.windows}.get(_view_of(window))
    if own is None:
        return {}
    place = window.depth_map(window.info.methods[0]).T_world_rv
    maps = {name: own.depth_map(name) for name in own.info.methods}
    return {
        name: replace(one, method=method_on_own_poses(name), T_world_rv=place)
        for name, one in maps.items()
    }


def _view_of(window: StoredWindow) -> tuple[str, int]:
    return window.info.name, window.info.t_ref_us


def own_estimates(
    stored: StoredMap, windows: Iterable[StoredWindow]
) -> Iterator[Mapping[str, Estimate]]:
    """What maps on found poses say of each window; of one without poses they say nothing."""
    for window in windows:
        maps = maps_on_own_poses(stored, window)
        yield {
            method_on_own_poses(name): _estimate(maps[name])
            if name in maps
            else _empty(window.depth_map(name))
            for name in window.info.methods
        }


def _estimate(depth_map: DepthMap) -> Estimate:
    return Estimate(depth_map.depth_m, depth_map.mask, depth_map.confidence, depth_map.rho)


def _empty(like: DepthMap) -> Estimate:
    nothing = np.zeros_like(like.mask)
    return Estimate(np.ones_like(like.depth_m), nothing, np.zeros_like(like.depth_m), like.rho)
