"""What is wrong with an estimate beside the truth, or must be known: units, clocks, gaps."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from eventsweep.emvs.errors import InputError, significant
from eventsweep.emvs.geometry.alignment import Similarity, align_points
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.config import TrajectoryConfig
from eventsweep.eval.scoring.trajectories.association import MatchedPoses

LEAST_PAIRS = 3
"""Fewer poses do not determine an alignment."""
_TIME_UNITS = {1e3: "ms", 1e6: "us", 1e9: "ns"}
_LENGTHS = {1e2: "centimetres", 1e3: "millimetres", 1e6: "micrometres", 1e9: "nanometres"}
_DECADES = 1.5
"""How far the lengths of two trajectories may be from a ratio of units, in powers of ten."""
_TIMES_LONGER = 100.0
"""An estimate so many times as long as the truth is of another unit of time."""
_ALIKE = 0.5
"""Two ways are the same but for their size where they are closer than this share of their size."""
_NEARLY = 0.25
_FREE_TURN_DEG = 2.0
_LOST_SHARE = 0.02
_TIME_SHARE = 0.2
_SCALE_PERCENT = 2.0


def check_times(truth: Trajectory, estimate: Trajectory, config: TrajectoryConfig) -> None:
    """Refuses trajectories that do not overlap in time, or have another unit of time.

    Raises:
        InputError: says when each begins and ends, and what may cure it.
    """
    begin_us, end_us = (t_us + config.offset_us for t_us in estimate.span_us)
    first_us, last_us = truth.span_us
    margin_us = config.max_difference_us
    overlap = begin_us - margin_us <= last_us and first_us <= end_us + margin_us
    fits = len(truth) < LEAST_PAIRS or end_us - begin_us < _TIMES_LONGER * (last_us - first_us)
    if overlap and fits:
        return
    said = "the two do not overlap" if not overlap else "they do not fit"
    raise InputError(
        f"times from {_seconds(begin_us)} to {_seconds(end_us)} s, but the truth's are from "
        f"{_seconds(first_us)} to {_seconds(last_us)} s: {said}; {_cure(truth, estimate, config)}"
    )


def _seconds(t_us: int) -> str:
    return f"{t_us / 1e6:.15g}"


def _cure(truth: Trajectory, estimate: Trajectory, config: TrajectoryConfig) -> str:
    """How to make the times fit: a unit, where it makes them overlap, or else an offset."""
    offset_s = (truth.t_us[0] - estimate.t_us[0]) / 1e6
    return _other_unit(truth, estimate, config) or (
        f"if the clocks differ, set offset_s, such as {offset_s:.15g} where both begin together"
    )


def _other_unit(truth: Trajectory, estimate: Trajectory, config: TrajectoryConfig) -> str:
    """Which unit would bring the middle of the estimate into the truth's time; empty where none.

    Of several, the one with which the two last most nearly as long as each other: where they last
    alike as it is, the clocks differ and not their units.
    """
    first_us, last_us = truth.span_us
    middle_us = sum(estimate.span_us) / 2 + config.offset_us
    lasts = [max(one.span_us[1] - one.span_us[0], 1) for one in (estimate, truth)]
    longer, found = math.log10(lasts[0] / lasts[1]), []
    for factor, unit in _TIME_UNITS.items():
        power = math.log10(factor)
        if first_us <= middle_us / factor <= last_us and config.unit == "s":
            said = f"they are {factor:g} times as large: set unit to {unit!r}"
            found.append((abs(longer - power), said))
        if first_us <= middle_us * factor <= last_us and config.truth_unit == "s":
            said = f"the truth's are {factor:g} times as large: set truth_unit to {unit!r}"
            found.append((abs(longer + power), said))
    off, said = min(found, default=(math.inf, ""))
    return said if off < _DECADES else ""


def check_pairs(
    matched: MatchedPoses, truth: Trajectory, estimate: Trajectory, config: TrajectoryConfig
) -> None:
    """Refuses too few pairs of poses."""
    t_us = estimate.t_us + config.offset_us
    within = (truth.t_us >= t_us[0] - config.max_difference_us) & (
        truth.t_us <= t_us[-1] + config.max_difference_us
    )
    true = int(np.count_nonzero(within))
    if min(len(matched), true) >= LEAST_PAIRS:
        return
    right = np.clip(np.searchsorted(truth.t_us, t_us), 0, len(truth) - 1)
    left = np.maximum(right - 1, 0)
    nearest_us = np.minimum(np.abs(truth.t_us[left] - t_us), np.abs(truth.t_us[right] - t_us))
    usual_s = float(np.median(nearest_us)) / 1e6
    fault = (
        f"{len(matched)} of {len(estimate)} poses have a true one, and {true} true ones lie in "
        f"their time; needs {LEAST_PAIRS} of both. The nearest is {usual_s:.3g} s away in the "
        "median: "
    )
    cure = _other_unit(truth, estimate, config) if true < LEAST_PAIRS else ""
    wider = "set max_difference_s above that, or " * (usual_s > config.max_difference_s)
    raise InputError(fault + (cure or f"{wider}give more poses"))


def check_size(matched: MatchedPoses, config: TrajectoryConfig) -> None:
    """Refuses an estimate that is the truth in another unit of length.

    A free scale (`sim3`) has no unit, and an estimate that went astray is of no other unit.
    """
    if config.align == "sim3":
        return
    true_m, estimated_m = matched.T_world_body[:, :3, 3], matched.T_odom_body[:, :3, 3]
    found = align_points(true_m, estimated_m, with_scale=True)
    size_m = np.sqrt(np.mean(np.sum((true_m - true_m.mean(axis=0)) ** 2, axis=1)))
    left_m = np.sqrt(np.mean(np.sum((found.points(estimated_m) - true_m) ** 2, axis=1)))
    if not size_m > 0 or not found.scale > 0 or left_m > _ALIKE * size_m:
        return
    for factor, name in _LENGTHS.items():
        if abs(found.scale * factor - 1) < _NEARLY:
            raise InputError(
                f"its path is {1 / found.scale:.4g} times as long as the truth's: it looks like "
                f"{name}; multiply its positions by {1 / factor:g}, or set align to 'sim3'"
            )
        if abs(found.scale / factor - 1) < _NEARLY:
            raise InputError(
                f"the truth's path is {found.scale:.4g} times as long: the truth looks like "
                f"{name}; multiply its positions by {1 / factor:g}, or set align to 'sim3'"
            )


def notes_on(
    matched: MatchedPoses, world_odom: Similarity, ate_m: float, truth: Trajectory,
    estimate: Trajectory, config: TrajectoryConfig,
) -> Iterator[str]:  # fmt: skip
    """What a reader of the numbers must know, a sentence each."""
    yield from _of_pairs(matched, ate_m, truth, estimate, config)
    if not matched.way_m[-1]:
        yield "the truth does not move: drift, errors by way and the scale are undefined"
    if not world_odom.is_unique:
        yield (
            "all positions are on a line or at one point: alignment cannot determine the "
            "rotation about it, so absolute rotation errors are undefined; see the relative ones"
        )
    elif config.align != "none" and _free_turn_deg(matched, ate_m) > _FREE_TURN_DEG:
        yield (
            "the path is so straight that alignment hardly determines the rotation about it: see "
            "the relative errors of rotation"
        )
    if config.align == "sim3" and 100 * abs(world_odom.scale - 1) > _SCALE_PERCENT:
        yield (
            f"sim3 multiplies the estimate by {world_odom.scale:.4g}: its errors hide that "
            "scale, which a stereo system should get right"
        )


def _of_pairs(
    matched: MatchedPoses, ate_m: float, truth: Trajectory, estimate: Trajectory,
    config: TrajectoryConfig,
) -> Iterator[str]:  # fmt: skip
    lost = len(estimate) - len(matched)
    if lost > _LOST_SHARE * len(estimate):
        interpolated = config.associate == "interpolate"
        near = "in its time" if interpolated else f"within {config.max_difference_s:g} s"
        fewer = len(truth) < len(estimate) and not interpolated
        cure = "; the truth has fewer poses, set associate to 'interpolate' to compare all" * fewer
        share = f"{lost} of {len(estimate)}"
        yield f"{share} poses have no true pose of their own {near}: left out{cure}"
    apart_m = _moved_meanwhile_m(matched, truth)
    if apart_m > _TIME_SHARE * ate_m:
        late_s = float(np.abs(matched.late_us).max()) / 1e6
        yield (
            f"poses are paired with true ones of up to {significant(late_s, 3)} s before or after, "
            f"which alone makes {significant(100 * apart_m, 3)} cm (RMS) of the ATE of "
            f"{significant(100 * ate_m, 3)} cm: set associate to 'interpolate' to leave it out"
        )


def _free_turn_deg(matched: MatchedPoses, ate_m: float) -> float:
    """How far the estimate may turn about its path before its errors (RMS) double, roughly, °."""
    true_m = matched.T_world_body[:, :3, 3]
    spreads_m = np.linalg.svd(true_m - true_m.mean(axis=0), compute_uv=False)
    beside_m = float(np.hypot(*spreads_m[1:])) / math.sqrt(len(true_m))
    return math.degrees(math.atan2(ate_m, beside_m))


def _moved_meanwhile_m(matched: MatchedPoses, truth: Trajectory) -> float:
    """How far the body moved between the times of the two poses of a pair, RMS, m."""
    within_us = np.clip(matched.t_us, *truth.span_us)
    moved = truth.at(within_us)[:, :3, 3] - matched.T_world_body[:, :3, 3]
    return float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
