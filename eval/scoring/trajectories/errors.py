"""Absolute and relative errors of paired poses: the formulas, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.alignment import Similarity
from eventsweep.eval.scoring.trajectories.association import MatchedPoses

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
StepUnit = Literal["pct", "m", "s", "deg"]
_TOLERANCE = 0.2
"""How far a pair may be from the step that is asked for, as a share of it."""


class Step(NamedTuple):
    """How far apart the two poses of a pair are: `pct` is a share of the whole way."""

    value: float
    unit: StepUnit

    def __str__(self) -> str:
        return f"{self.value:g}{self.unit}"


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Absolute errors, of each pair of poses.

    Attributes:
        translation_m: (N,) distance of the aligned estimate from the truth, m.
        rotation_deg: (N,) angle between the two, °; NaN where the alignment leaves it open.
    """

    translation_m: Floats
    rotation_deg: Floats


@dataclass(frozen=True, eq=False)
class StepErrors:
    """Relative errors, of each step from one pose to a later one.

    Attributes:
        start: (K,) index of the first pose.
        end: (K,) index of the second.
        way_m: (K,) true way between the two, m.
        translation_m: (K,) how far the estimated step ends from the true one, m.
        rotation_deg: (K,) angle between the two ends, °.
    """

    start: Indices
    end: Indices
    way_m: Floats
    translation_m: Floats
    rotation_deg: Floats

    def __len__(self) -> int:
        return len(self.start)


def absolute_errors(matched: MatchedPoses, world_odom: Similarity) -> PoseErrors:
    """Errors of every pose after alignment.

    As Sturm et al. (IROS 2012) and Zhang & Scaramuzza (IROS 2018), eqs. 4 to 6.

    Args:
        matched: pairs of poses.
        world_odom: aligns the estimate's world with the truth's.
    """
    T_world_body, T_world_est = matched.T_world_body, world_odom.poses(matched.T_odom_body)
    translation_m = np.linalg.norm(T_world_est[:, :3, 3] - T_world_body[:, :3, 3], axis=1)
    rotation_deg = angles_deg(se3.inverse(T_world_body) @ T_world_est)
    if not world_odom.is_unique:
        rotation_deg = np.full_like(rotation_deg, np.nan)
    return PoseErrors(translation_m, rotation_deg)


def relative_errors(matched: MatchedPoses, step: Step, scale: float = 1.0) -> StepErrors:
    """Errors of every step of one length: `E = (T_w_i⁻¹ T_w_j)⁻¹ (T_o_i⁻¹ T_o_j)`.

    As Geiger et al. (CVPR 2012) and Zhang & Scaramuzza (IROS 2018), eqs. 8 to 10. No alignment has
    any effect, but for its scale.

    Args:
        matched: pairs of poses.
        step: how far apart, measured on the true poses.
        scale: what the estimate's lengths are multiplied by.
    """
    way_m = matched.way_m
    start, end = steps_of(_progress(matched, step, way_m), _length(step, way_m))
    true = se3.inverse(matched.T_world_body[start]) @ matched.T_world_body[end]
    estimated = se3.inverse(matched.T_odom_body[start]) @ matched.T_odom_body[end]
    estimated[:, :3, 3] *= scale
    error = se3.inverse(true) @ estimated
    translation_m = np.linalg.norm(error[:, :3, 3], axis=1)
    return StepErrors(start, end, way_m[end] - way_m[start], translation_m, angles_deg(error))


def steps_of(progress: Floats, length: float) -> tuple[Indices, Indices]:
    """From every pose the one whose progress is nearest to `length` more, if it is off by < 20 %.

    As rpg_trajectory_evaluation pairs them, of equally near ones the first.

    Args:
        progress: (N,) way, time or angle so far: never decreasing.
        length: how much more, in the same unit.

    Returns:
        Indices of the first and of the second pose of each step.
    """
    aim = progress + length
    after = np.minimum(np.searchsorted(progress, aim), len(progress) - 1)
    before = np.maximum(after - 1, 0)
    end = np.where(aim - progress[before] <= np.abs(progress[after] - aim), before, after)
    end = np.searchsorted(progress, progress[end])
    # Where all of the way dwarfs the length, the sum rounds to no step at all.
    near = (np.abs(progress[end] - aim) < _TOLERANCE * length) & (progress[end] > progress)
    start = np.flatnonzero(near)
    return start, end[start]


def angles_deg(T: Floats) -> Floats:
    """(N,) angles of the rotations of (N, 4, 4) motions, °."""
    turned: Floats = np.degrees(Rotation.from_matrix(T[:, :3, :3]).magnitude())
    return turned


def _length(step: Step, way_m: Floats) -> float:
    return step.value / 100 * float(way_m[-1]) if step.unit == "pct" else step.value


def _progress(matched: MatchedPoses, step: Step, way_m: Floats) -> Floats:
    if step.unit == "s":
        return np.asarray((matched.t_us - matched.t_us[0]) / 1e6, np.float64)
    if step.unit == "deg":
        T = matched.T_world_body
        return np.concatenate([[0.0], np.cumsum(angles_deg(se3.inverse(T[:-1]) @ T[1:]))])
    return way_m
