"""How far off poses may be: what a batch leaves open, and what every map adds.

A pose is found on a map, so it errs by what its batch leaves open, as the filter says, and by what
the map errs. Each map is made on poses, and errs as they do, independently of the last one: a
random walk, whose steps a turn of the world swings about the place where they were taken. The way
errs by the scale that stereo leaves open, too, which hardly changes from map to map. And neither a
calibration nor where edges match is exact: an angle between the cameras that is off by eps shifts
all disparities by f eps, and so all inverse depths by eps / b, whatever the depth. On such a map a
camera that moves by v across sees what it would by turning by eps v / b, too: the path turns the
same way all along. Where events and map disagree the motion may be another; a map made there agrees
with it, but has lost how far the path has come.

So errors are drift: within a track they hardly change from pose to pose, and all its poses lie in
their regions or few do. Regions are right over many tracks.

What is known of the path so is a share of it, and a share of a short way is soon less than events
can show: `Way` says when.

Covariances are (6, 6), of position, m, and turn, rad, both along the axes of the world:
p_true = p + dp, R_true = exp(d_theta) R_world_body, as robots' messages have them.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from eventsweep.plugins.track.odometry.checkpoint import State
from eventsweep.plugins.track.odometry.motion import Motion

Matrix = NDArray[np.float64]
_BATCH = 1.0  # standard deviations over those that the filter says
_ALIKE_S = 0.144
"""For so long batches that follow each other err alike; a map errs as the mean over its window."""
_TURN = 0.0008  # rad, between the cameras: about 0.2 px on sensors of 240 and 346 columns
_NO_BASELINE = 0.13  # of the depth: one camera sees it by the way that a map is made on
_SCALE = 0.03, 0.1  # standard deviations: of one camera, that sees none; at most
_DOUBTED = 0.5  # of a way on which events and map disagree: it may be as wrong
_KEPT = 1024  # poses since the last map
_CLEAR = 2.0  # standard deviations of a pose, that a step is longer than: noise is no way
MOST_SHARE = 0.02
"""Of a way, by which the poses of a path may be off that is believed."""


class Drift:
    """The covariance of poses from the first one on, which is the world's origin.

    Args:
        baseline_m: between the cameras; 0 where there is one.
    """

    def __init__(self, baseline_m: float = 0.0) -> None:
        self.way_m, self._scale_sigma = 0.0, _SCALE[0]
        self._baseline_m, self._ways = baseline_m, 0.0  # over the baseline
        self._walk: Matrix | None = None
        self._noted_m, self._astray_m = 0.0, 0.0
        self._doubted: deque[tuple[int, float]] = deque(maxlen=_KEPT)  # times, steps up to them, m
        self._batch = np.zeros((6, 6))
        self._place = self._scaled_m = np.zeros(3)  # by a scale off by its standard deviation

    def at(self, motion: Motion, per_depth: float) -> Matrix:
        """The (6, 6) covariance of a pose; the next ones follow from there.

        Args:
            motion: the pose.
            per_depth: mean inverse depth of what is seen, 1/m.
        """
        R, place = motion.T_world_body[:3, :3], motion.T_world_body[:3, 3]
        turned = np.zeros((6, 6))
        turned[:3, :3] = turned[3:, 3:] = R
        self._batch = turned @ motion.covariance[:6, :6] @ turned.T
        if self._walk is None:
            self._walk = _BATCH**2 * self._batch
            self._place = place
        step_m = float(np.linalg.norm(place - self._place))
        self._scaled_m = self._scaled_m + self._scale_sigma * (place - self._place)
        per_m = 1 / self._baseline_m if self._baseline_m else per_depth / _NO_BASELINE
        self.way_m, self._ways = self.way_m + step_m, self._ways + per_m * step_m
        J = np.eye(6)
        J[:3, 3:] = -_cross(place - self._place)
        self._walk, self._place = J @ self._walk @ J.T, place
        covariance: Matrix = self._walk + _BATCH**2 * self._batch + self._by_scale()
        return covariance + self._by_calibration()

    @property
    def is_astray(self) -> bool:
        """Whether maps on doubted poses may have led the path off by over `MOST_SHARE` of it."""
        return _DOUBTED * self._astray_m > MOST_SHARE * self.way_m

    def note(self, t_us: int, *, is_doubted: bool) -> None:
        """Says whether events and map disagreed at the last pose: a map on it errs as it does."""
        if is_doubted:
            self._doubted.append((t_us, self.way_m - self._noted_m))
        self._noted_m = self.way_m

    def found_again(self) -> None:
        """Says that the last pose was found on maps from before it was doubted."""
        self._doubted.clear()
        self._noted_m = self.way_m

    def next_map(self, scale_sigma: float, window_us: tuple[int, int]) -> None:
        """Says that a map is tracked from here on.

        Args:
            scale_sigma: how well stereo measures its scale.
            window_us: the times of the first and the last pose that it was made on.
        """
        since_us, until_us = window_us
        if self._walk is not None:
            share = 1e6 * _ALIKE_S / max(until_us - since_us, 1)
            self._walk = self._walk + share * self._batch + self._by_doubt(until_us)
        if self._baseline_m:
            self._scale_sigma = min(scale_sigma, _SCALE[1])

    def _by_scale(self) -> Matrix:
        off = np.concatenate([self._scaled_m, np.zeros(3)])
        return np.outer(off, off)

    def _by_doubt(self, until_us: int) -> Matrix:
        doubted_m = 0.0
        while self._doubted and self._doubted[0][0] <= until_us:
            doubted_m += self._doubted.popleft()[1]
        self._astray_m += doubted_m
        return np.diag(np.repeat([(_DOUBTED * doubted_m) ** 2 / 3, 0.0], 3))

    def _by_calibration(self) -> Matrix:
        turn = _TURN * self._ways
        return np.diag(np.repeat([turn * self.way_m / 2, turn], 3) ** 2)

    def state(self) -> State:
        """All that decides what it says from now on."""
        return {**vars(self), "_doubted": [list(each) for each in self._doubted]}

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        steps = ((t_us, step_m) for t_us, step_m in state["_doubted"])
        vars(self).update({**state, "_doubted": deque(steps, _KEPT)})


class Way:
    """How long the path is that nothing speaks against, and how well its poses are known.

    What a batch leaves open of a pose is as long on any path. Aligned, paths of twins lie about
    half as far off the true ones, and hardly ever farther than all of it.
    """

    def __init__(self) -> None:
        self.length_m = 0.0
        self._variances, self._poses = 0.0, 0
        self._place: Matrix | None = None

    @property
    def is_known(self) -> bool:
        """Whether the standard deviation of its poses is at most `MOST_SHARE` of its length."""
        most = self._poses * (MOST_SHARE * self.length_m) ** 2
        return self._poses > 0 and self._variances <= most

    def add(self, motion: Motion) -> None:
        """Takes the next pose."""
        place, variance = motion.T_world_body[:3, 3], float(np.trace(motion.covariance[:3, :3]))
        self._variances, self._poses = self._variances + variance, self._poses + 1
        step_m = 0.0 if self._place is None else float(np.linalg.norm(place - self._place))
        if self._place is None or step_m > _CLEAR * variance**0.5:
            self.length_m, self._place = self.length_m + step_m, place

    def interrupt(self) -> None:
        """Says that the next pose does not follow; what is not known by now begins anew."""
        if not self.is_known:
            self.length_m, self._variances, self._poses = 0.0, 0.0, 0
        self._place = None

    def state(self) -> State:
        """All that decides what it says from now on."""
        return dict(vars(self))

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        vars(self).update(state)


def _cross(v: Matrix) -> Matrix:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
