"""Scores for users of the library: of a window that was just mapped, or of a folder."""

from __future__ import annotations

from pathlib import Path

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets import opened
from eventsweep.emvs.errors import InputError, check_type, located, shown
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.maps.folder import StoredMap
from eventsweep.emvs.window_result import WindowResult
from eventsweep.eval import pipeline
from eventsweep.eval.config import EvalConfig, TrajectoryConfig
from eventsweep.eval.results.results import Results
from eventsweep.eval.results.table import together
from eventsweep.eval.scoring import run_folder
from eventsweep.eval.scoring.case import CaseMaps, event_rows, sample_of
from eventsweep.eval.scoring.metric_versions import metric_versions
from eventsweep.eval.scoring.pairing import REFERENCE
from eventsweep.eval.scoring.score import case_rows, pairs_of_maps, rig_rows
from eventsweep.eval.scoring.significance import interval as confidence_interval
from eventsweep.eval.scoring.trajectories.metrics import KNOWN_METRICS as METRICS
from eventsweep.eval.scoring.trajectories.score import TrajectoryScore, score_poses
from eventsweep.eval.scoring.trajectories.sources import read_estimate, read_truth

__all__ = [
    "METRICS",
    "confidence_interval",
    "score",
    "score_trajectory",
]

_WINDOW = "w000"


def score(
    mapped: WindowResult | StoredMap | str | Path,
    recording: Recording | str | Path | None = None,
    config: EvalConfig | None = None,
) -> Results:
    """Scores depth maps against the ground truth at their reference time.

    Args:
        mapped: what `map_window` gave, which needs its recording beside it; or what `map_windows`
            gave, or the folder of a map or run, where `results.json` and `results.csv` are written.
        recording: with ground truth, or its path; a folder knows its own.
        config: masks and limits.

    Raises:
        InputError: no ground truth at the reference time, a view of the map's own, a folder without
            maps, damaged files, or a recording too many or too few.
    """
    config = EvalConfig.or_default(config)
    if isinstance(mapped, WindowResult):
        if recording is None:
            raise InputError(
                "a window's result without its recording: call score(result, recording)"
            )
        return _score_window(mapped, opened(recording), config)
    if recording is not None:
        raise InputError(
            "a map's folder and a recording: the folder knows its recording, leave it out"
        )
    check_type("mapped", mapped, (StoredMap, str, Path), "a window, a map or a folder's path")
    folder = mapped.path if isinstance(mapped, StoredMap) else Path(mapped)
    return pipeline.score_folder(folder, config)


def score_trajectory(
    estimate: Trajectory | str | Path,
    truth: Trajectory | Recording | str | Path,
    config: TrajectoryConfig | None = None,
) -> TrajectoryScore:
    """Scores an estimated trajectory: ATE, relative errors, drift, time covered.

    Args:
        estimate: poses of the body, in a world of their own, or a TUM file of them, or the folder
            of a tracker.
        truth: true poses of the same body, or a TUM file of them; or a recording or its folder,
            whose poses are the truth.
        config: alignment, association, and what relative errors are taken over.

    Returns:
        `values` by metric, `notes`, all errors, and `to_results()`, which is a table.

    Raises:
        InputError: an unreadable file, no overlap in time, another unit of time or length, or too
            few poses.
    """
    config = TrajectoryConfig.or_default(config)
    check_type("estimate", estimate, (Trajectory, str, Path), "a Trajectory or a path")
    if isinstance(truth, str | Path):
        truth = read_truth(truth, config).trajectory
    true = getattr(truth, "trajectory", truth)
    if not isinstance(true, Trajectory):
        raise InputError(f"truth is {shown(truth)}: needs a Trajectory, a recording or a path")
    if isinstance(estimate, Trajectory):
        return score_poses(true, estimate, config)
    found = read_estimate(Path(estimate), config)
    with located(found.path):
        return score_poses(true, found.trajectory, config)


def _score_window(result: WindowResult, recording: Recording, config: EvalConfig) -> Results:
    run_folder.check_view(result.config, recording.name)
    scored = run_folder.with_ground_truth(recording)
    pairs = pairs_of_maps(scored, result.window, result.depth_maps, config, reference=REFERENCE)
    rows = [
        case_rows(scored.name, {_WINDOW: pairs}),
        event_rows(scored.name, [([c.to_json() for c in result.counts], result.event_image)]),
        rig_rows(scored.name, scored, [result.window]),
    ]
    settings = {
        **run_folder.provenance(scored),
        "map": result.config.model_dump(mode="json"),
    }
    return Results(
        together(rows),
        {"score": config.model_dump(mode="json"), scored.name: settings},
        (sample_of(CaseMaps(scored.name, scored, {}), metric_versions()),),
    )
