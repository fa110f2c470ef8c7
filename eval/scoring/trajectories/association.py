"""Which estimated pose belongs to which true one, by their times."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.windows import longest_gap_us
from eventsweep.eval.config import Association

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
Indices = tuple[NDArray[np.intp], NDArray[np.intp]]


@dataclass(frozen=True, eq=False)
class MatchedPoses:
    """Pairs of an estimated and a true pose, in the order of the estimate's times.

    Attributes:
        t_us: (N,) times of the estimated poses, on the truth's clock, µs.
        late_us: (N,) how much later that is than the time of the true pose, µs.
        T_world_body: (N, 4, 4) true poses.
        T_odom_body: (N, 4, 4) estimated poses, in a world of the estimate's own.
    """

    t_us: Times
    late_us: Times
    T_world_body: Floats
    T_odom_body: Floats

    def __len__(self) -> int:
        return len(self.t_us)

    @property
    def way_m(self) -> Floats:
        """(N,) how long the true way to each pose is, from one to the next, m."""
        steps_m = np.linalg.norm(np.diff(self.T_world_body[:, :3, 3], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps_m)])

    @property
    def both_move(self) -> bool:
        """Whether neither stays at one point: else there is no scale between the two."""
        ways = (self.T_world_body[:, :3, 3], self.T_odom_body[:, :3, 3])
        return all(bool(np.ptp(positions_m, axis=0).any()) for positions_m in ways)


def associate(
    truth: Trajectory, estimate: Trajectory, rule: Association, max_difference_us: int,
    offset_us: int = 0,
) -> MatchedPoses:  # fmt: skip
    """Pairs poses by their times.

    Args:
        truth: `T_world_body`.
        estimate: `T_odom_body`.
        rule: `one-to-one`, `nearest` or `interpolate`, see the functions below.
        max_difference_us: how far apart the two times of a pair may lie, that included; the third
            rule does not need it.
        offset_us: added to the estimate's times.
    """
    t_us = estimate.t_us + offset_us
    T_odom_body = estimate.at(estimate.t_us)
    if rule == "interpolate":
        known = covered(truth, t_us)
        at_us = t_us[known]
        T_world_body = truth.at(at_us)
        return MatchedPoses(at_us, np.zeros_like(at_us), T_world_body, T_odom_body[known])
    of_truth, of_estimate = _RULES[rule](truth.t_us, t_us, max_difference_us)
    late_us = t_us[of_estimate] - truth.t_us[of_truth]
    T_world_body = truth.at(truth.t_us[of_truth])
    return MatchedPoses(t_us[of_estimate], late_us, T_world_body, T_odom_body[of_estimate])


def one_to_one(truth_us: Times, estimate_us: Times, max_difference_us: int) -> Indices:
    """Pairs the two that lie closest in time, then the closest of what is left, and so on.

    As `associate.py` of the TUM RGB-D benchmark and rpg_trajectory_evaluation do: equal differences
    go to the earlier estimate, then to the earlier truth. The closest two of all that is left are
    always neighbours in time, so only neighbours are compared.

    Args:
        truth_us: (M,) strictly increasing times, µs.
        estimate_us: (N,) likewise.
        max_difference_us: how far apart two may lie, that included.

    Returns:
        Indices of truth and estimate, (K,) each, the latter increasing.
    """
    times = np.concatenate([truth_us, estimate_us])
    order = np.argsort(times, kind="stable")
    line = _Timeline(times[order].tolist(), order.tolist(), len(truth_us), max_difference_us)
    pairs = np.array(sorted(line.closest_first()), np.intp).reshape(-1, 2)
    return pairs[:, 1], pairs[:, 0]


class _Timeline:
    """The times of both trajectories in order, of which pairs of neighbours are taken out."""

    def __init__(
        self, times: list[int], order: list[int], truths: int, max_difference_us: int
    ) -> None:
        self._times, self._order, self._truths = times, order, truths
        self._most_us = max_difference_us
        self._before, self._after = list(range(-1, len(times) - 1)), list(range(1, len(times) + 1))
        self._is_left = [True] * len(times)
        self._heap: list[tuple[int, int, int, int, int]] = []

    def closest_first(self) -> list[tuple[int, int]]:
        """All pairs (estimate, truth)."""
        for k in range(len(self._times) - 1):
            self._offer(k, k + 1)
        pairs = []
        while self._heap:
            _, estimate, truth, first, second = heapq.heappop(self._heap)
            if self._is_left[first] and self._is_left[second]:
                pairs.append((estimate, truth))
                self._take_out(first, second)
        return pairs

    def _offer(self, first: int, second: int) -> None:
        one, two = self._order[first], self._order[second]
        gap_us = self._times[second] - self._times[first]
        if gap_us > self._most_us or (one < self._truths) == (two < self._truths):
            return
        truth, estimate = min(one, two), max(one, two) - self._truths
        heapq.heappush(self._heap, (gap_us, estimate, truth, first, second))

    def _take_out(self, first: int, second: int) -> None:
        before, after = self._before[first], self._after[second]
        self._is_left[first] = self._is_left[second] = False
        if before >= 0:
            self._after[before] = after
        if after < len(self._times):
            self._before[after] = before
        if before >= 0 and after < len(self._times):
            self._offer(before, after)


def nearest(truth_us: Times, estimate_us: Times, max_difference_us: int) -> Indices:
    """Pairs every pose of the trajectory with fewer poses with the nearest one of the other.

    As evo does, where the one with more poses may be the truth or the estimate; of two equally near
    ones the earlier. A pose of the longer trajectory may be in several pairs.
    """
    if len(estimate_us) <= len(truth_us):
        return _nearest(truth_us, estimate_us, max_difference_us)
    of_estimate, of_truth = _nearest(estimate_us, truth_us, max_difference_us)
    return of_truth, of_estimate


def _nearest(long_us: Times, short_us: Times, max_difference_us: int) -> Indices:
    after = np.clip(np.searchsorted(long_us, short_us), 1, max(len(long_us) - 1, 1))
    after = np.minimum(after, len(long_us) - 1)
    before = np.maximum(after - 1, 0)
    closer = np.where(short_us - long_us[before] <= long_us[after] - short_us, before, after)
    near = np.flatnonzero(np.abs(long_us[closer] - short_us) <= max_difference_us)
    return closer[near], near


def covered(truth: Trajectory, t_us: Times) -> NDArray[np.bool_]:
    """(N,) whether the truth can be interpolated at each time: within its span, and in no gap.

    A gap is longer than ten median steps and longer than 50 ms, as for the poses of a recording.
    """
    first_us, last_us = truth.span_us
    within = (t_us >= first_us) & (t_us <= last_us)
    left = np.clip(np.searchsorted(truth.t_us, t_us, side="right") - 1, 0, len(truth) - 1)
    right = np.minimum(left + 1, len(truth) - 1)
    is_pose = truth.t_us[left] == t_us
    step_us = truth.t_us[right] - truth.t_us[left]
    is_known: NDArray[np.bool_] = is_pose | (step_us <= longest_gap_us(truth, MapperConfig()))
    return within & is_known


_RULES: dict[str, Callable[[Times, Times, int], Indices]] = {
    "one-to-one": one_to_one, "nearest": nearest,
}  # fmt: skip
