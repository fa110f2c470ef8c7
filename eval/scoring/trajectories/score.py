"""One estimate against the truth: paired, aligned, scored, and what to know about the numbers."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import ByName, InputError
from eventsweep.emvs.geometry.alignment import Similarity, align_points
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.windows import longest_gap_us
from eventsweep.eval.config import TrajectoryConfig
from eventsweep.eval.results.results import Results, Sample
from eventsweep.eval.results.table import POOLED, tidy
from eventsweep.eval.scoring.method_scores import Score
from eventsweep.eval.scoring.trajectories.association import MatchedPoses, associate
from eventsweep.eval.scoring.trajectories.errors import absolute_errors, relative_errors
from eventsweep.eval.scoring.trajectories.faults import (
    check_pairs,
    check_size,
    check_times,
    notes_on,
)
from eventsweep.eval.scoring.trajectories.metrics import (
    TrajectoryErrors,
    metrics_of,
    steps_of_config,
)

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TrajectoryScore:
    """The scores of one estimate, and the errors that they are made of.

    Attributes:
        scores: every number, as rows of a table of scores have them.
        matched: the pairs of poses.
        world_odom: aligns the estimate's world with the truth's.
        errors: of every pose and step.
        notes: what a reader of the numbers must know, a sentence each.
        config: how it was scored.
        truth_sha256: hash of the true poses.
    """

    scores: tuple[Score, ...]
    matched: MatchedPoses
    world_odom: Similarity
    errors: TrajectoryErrors
    notes: tuple[str, ...]
    config: TrajectoryConfig
    truth_sha256: str

    @property
    def values(self) -> Mapping[str, float]:
        """The numbers by metric; lengths in m, angles in °, shares in %."""
        return ByName("metric", {score.metric: score.value for score in self.scores})

    def __repr__(self) -> str:
        values = self.values
        return (
            f"TrajectoryScore({len(self.matched)} poses, way {values['way']:.4g} m, "
            f"ATE {values['ate_rmse']:.4g} m and {values['ate_rotation_rmse']:.3g}°, drift "
            f"{values['drift']:.3g} %, time covered {values['time_covered']:.4g} %)"
        )

    def to_results(self, case: str = "trajectory", method: str = "estimate") -> Results:
        """The numbers as a table with provenance, such as `write_results` takes."""
        return results_of(case, {method: self})


def score_poses(
    truth: Trajectory, estimate: Trajectory, config: TrajectoryConfig | None = None
) -> TrajectoryScore:
    """Pairs, aligns and scores an estimate.

    Args:
        truth: `T_world_body`.
        estimate: of the same body, in a world of its own.
        config: how.

    Raises:
        InputError: no overlap in time, another unit of time or length, too few pairs of poses, or a
            scale to find where the estimate or the truth does not move.
    """
    config = TrajectoryConfig.or_default(config)
    check_times(truth, estimate, config)
    matched = associate(
        truth, estimate, config.associate, config.max_difference_us, config.offset_us
    )
    check_pairs(matched, truth, estimate, config)
    check_size(matched, config)
    world_odom = _alignment(matched, config)
    errors = _errors(matched, world_odom, truth, estimate, config)
    scores = tuple(metric.score(errors) for metric in metrics_of(steps_of_config(config)))
    ate_m = scores[0].value
    found = notes_on(matched, world_odom, ate_m, truth, estimate, config)
    read = [*(f"truth: {note}" for note in truth.notes), *estimate.notes]
    notes = (*read, *found)
    return TrajectoryScore(scores, matched, world_odom, errors, notes, config, sha256_of(truth))


def _alignment(matched: MatchedPoses, config: TrajectoryConfig) -> Similarity:
    if config.align == "none":
        return Similarity.identity()
    with_scale = config.align == "sim3"
    if with_scale and not matched.both_move:
        raise InputError(
            f"all {len(matched)} positions are the same{' of the truth' * (not matched.way_m[-1])}"
            ": align 'sim3' has no scale to find; set align to 'se3'"
        )
    true_m, estimated_m = matched.T_world_body[:, :3, 3], matched.T_odom_body[:, :3, 3]
    return align_points(true_m, estimated_m, with_scale=with_scale)


def _errors(
    matched: MatchedPoses, world_odom: Similarity, truth: Trajectory, estimate: Trajectory,
    config: TrajectoryConfig,
) -> TrajectoryErrors:  # fmt: skip
    true_m, estimated_m = matched.T_world_body[:, :3, 3], matched.T_odom_body[:, :3, 3]
    free = align_points(true_m, estimated_m, with_scale=True)
    first_us, last_us = truth.span_us
    return TrajectoryErrors(
        poses=absolute_errors(matched, world_odom),
        steps={
            step: relative_errors(matched, step, world_odom.scale)
            for step in steps_of_config(config)
        },
        way_m=float(matched.way_m[-1]),
        truth_s=(last_us - first_us) / 1e6,
        covered_s=_covered_s(matched, truth, estimate),
        scale=free.scale if matched.both_move else np.nan,
    )


def _covered_s(matched: MatchedPoses, truth: Trajectory, estimate: Trajectory) -> float:
    """Time between neighbouring pairs of poses, but for gaps, within the truth's span, s."""
    gaps_us = np.diff(np.clip(matched.t_us, *truth.span_us))
    return float(gaps_us[gaps_us <= longest_gap_us(estimate, MapperConfig())].sum()) / 1e6


def sha256_of(trajectory: Trajectory) -> str:
    """A hash over all poses: numbers are comparable where the truth is the same."""
    digest = hashlib.sha256()
    for column in (trajectory.t_us, trajectory.positions_m, trajectory.quats_xyzw):
        digest.update(np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


def case_rows(case: str, scored: Mapping[str, TrajectoryScore]) -> pd.DataFrame:
    """The rows of one case, by the estimates' names."""
    return tidy(
        {"case": case, "window": POOLED, "method": method, **score._asdict()}
        for method, found in scored.items()
        for score in found.scores
    )


def results_of(
    case: str, scored: Mapping[str, TrajectoryScore], about: Mapping[str, Any] | None = None
) -> Results:
    """Scores of one or more estimates of one case, with where they came from.

    Args:
        case: its name.
        scored: by the estimates' names; all against the same truth, with the same settings.
        about: what else the configuration says of the case.
    """
    first = next(iter(scored.values()))
    notes = {name: list(found.notes) for name, found in scored.items()}
    return Results(
        case_rows(case, scored),
        {"score": first.config.model_dump(mode="json"), case: {**(about or {}), "notes": notes}},
        (Sample(case, sequence=first.truth_sha256, metrics=metric_versions()),),
    )


def metric_versions() -> dict[str, str]:
    """What each metric makes of fixed trajectories, as a hash: it changes with its meaning."""
    t = np.arange(200) / 20
    truth_m = np.stack([np.cos(t), np.sin(t), t / 8], axis=1)
    estimate_m = truth_m + 0.01 * np.stack([np.sin(3 * t), t, np.cos(5 * t)], axis=1)
    half = t / 16
    quats = np.stack([0 * t, 0 * t, np.sin(half), np.cos(half)], axis=1)
    turned = np.stack([0 * t, 0 * t, np.sin(1.01 * half), np.cos(1.01 * half)], axis=1)
    t_us = np.round(1e6 * t).astype(np.int64)
    found = score_poses(Trajectory(t_us, truth_m, quats), Trajectory(t_us, estimate_m, turned))
    texts = {
        score.metric: f"{score.value:.6g} {score.unit} {score.direction}" for score in found.scores
    }
    return {name: hashlib.sha256(text.encode()).hexdigest()[:12] for name, text in texts.items()}
