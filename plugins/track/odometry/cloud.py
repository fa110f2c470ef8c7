"""The map that is tracked: points of the newest depth maps, a bounded number of both."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry.checkpoint import State

Matrix = NDArray[np.float64]
_FADE = 0.8  # weight of each older map


class MapCloud:
    """Points of at most `maps` depth maps."""

    def __init__(self, maps: int) -> None:
        self._maps: deque[Matrix] = deque(maxlen=maps)
        self._added = 0

    def __len__(self) -> int:
        """Points of all maps."""
        return sum(map(len, self._maps))

    def add(self, points_world: Matrix) -> None:
        """Takes the (N, 3) points of a further map; the oldest may go for it."""
        self._maps.append(points_world)
        self._added += 1

    def replace(self, points_world: Matrix) -> None:
        """Takes a map instead of all before."""
        self._maps.clear()
        self.add(points_world)

    def state(self) -> State:
        """All points, map by map."""
        return {"maps": list(self._maps), "added": self._added}

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        self._maps.clear()
        self._maps.extend(state["maps"])
        self._added = state["added"]

    def chosen(self, most: int) -> Matrix:
        """At most so many points, at random, but the same in every run; newer maps count more."""
        points = np.concatenate(self._maps)
        if len(points) <= most:
            return points
        weights = np.concatenate(
            [
                np.full(len(each), _FADE**age / len(each))
                for age, each in zip(reversed(range(len(self._maps))), self._maps, strict=True)
                if len(each)
            ]
        )
        rng = np.random.default_rng(self._added)
        at = rng.choice(len(points), most, replace=False, p=weights / weights.sum(), shuffle=True)
        return points[at]


def points_of(depth_map: DepthMap) -> Matrix:
    """The (N, 3) points of a depth map in the world, m."""
    rows, columns = np.nonzero(depth_map.mask)
    bearing = depth_map.camera.unproject(np.stack([columns, rows], axis=-1).astype(np.float64))
    z_m = depth_map.depth_m[rows, columns].astype(np.float64)[:, None]
    return se3.transform(depth_map.T_world_rv, np.hstack([bearing * z_m, z_m]))
