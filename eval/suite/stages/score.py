"""The third stage of a suite's jobs: the depth maps of one sequence against ground truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.maps.folder import StoredWindow, read_map
from eventsweep.emvs.maps.store import read_entry
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.found_poses import found_poses
from eventsweep.eval.jobs.job import RESULT, SEQUENCE
from eventsweep.eval.scoring.metric_versions import metric_versions
from eventsweep.eval.scoring.results import POOLED, tidy, together
from eventsweep.eval.scoring.score import score_windows
from eventsweep.eval.scoring.trajectories import score as trajectories
from eventsweep.eval.scoring.trajectories.own_poses import own_estimates, pose_rows
from eventsweep.eval.suite.results import EVENTS, Sample, SampleFacts, mapper_method, sample_text

if TYPE_CHECKING:
    import pandas as pd


def run(parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path) -> None:
    """Scores every window and all of them pooled, for each of the case's mappers.

    With `track` the last input is what that stage made: its poses and maps are scored, too.
    """
    case, config = str(parameters["case"]), EvalConfig.model_validate(parameters["score"])
    sequence = EventSequence.open(inputs[0] / SEQUENCE)
    count, tracked = len(parameters["mappers"]), bool(parameters.get("track"))
    stored = [mapped_window(path) for path in inputs[1 : 1 + count]]
    tables: list[pd.DataFrame] = []
    for mapper, windows in _by_mapper(parameters["mappers"], stored).items():
        own = own_estimates(read_map(inputs[-1] / mapper), windows) if tracked else None
        scored = score_windows(case, sequence, windows, config, own)
        tables.append(scored.assign(method=[mapper_method(m, mapper) for m in scored["method"]]))
        if mapper == parameters["mappers"][0]:
            tables.append(_event_rows(case, windows))
    facts = sample_facts(sequence, str(parameters["scene_digest"]))
    if tracked:
        tables.append(pose_rows(case, sequence.trajectory, found_poses(inputs[-1]))[0])
        facts = replace(facts, metrics={**facts.metrics, **trajectories.metric_versions()})
    sample = Sample(case, int(parameters["seed"]), facts)
    (out / RESULT).write_text(sample_text(sample, together(tables)), encoding="utf-8")


def mapped_window(mapped: Path) -> StoredWindow:
    """The window that a mapping job made."""
    info = read_entry(mapped)
    return StoredWindow(mapped / info.name, info)


def _by_mapper(
    mappers: Sequence[str], stored: Sequence[StoredWindow]
) -> dict[str, list[StoredWindow]]:
    found: dict[str, list[StoredWindow]] = {}
    for mapper, window in zip(mappers, stored, strict=True):
        found.setdefault(mapper, []).append(window)
    return found


def _event_rows(case: str, windows: Sequence[StoredWindow]) -> pd.DataFrame:
    """Event statistics: a fault may lose some without a trace in the depth."""
    counts = [camera for window in windows for camera in window.info.counts.values()]
    total = {name: sum(camera[name] for camera in counts) for name in counts[0]}
    outcomes = ("counted", "outside_image", "behind_camera")
    votes = sum(total[f"votes_{outcome}"] for outcome in outcomes)
    image = sum(window.event_image.sum((1, 2), dtype=np.int64) for window in windows)
    shares = {
        "brighter_share": (image[1], image.sum(), "none"),
        "voting_share": (total["voting"], total["events"], "higher"),
        "votes_in_image_share": (total["votes_counted"], votes, "none"),
    }
    numbers = [
        ("events", float(total["events"]), "events", "none"),
        ("dropped_tail", float(total["dropped_tail"]), "events", "lower"),
    ]
    for name, (part, whole, direction) in shares.items():
        share = 100 * float(part) / float(whole) if whole else math.nan
        numbers.append((name, share, "%", direction))
    about = {"case": case, "window": POOLED, "method": EVENTS}
    names = ("metric", "value", "unit", "direction")
    return tidy(about | dict(zip(names, number, strict=True)) for number in numbers)


def sample_facts(sequence: EventSequence, scene_digest: str) -> SampleFacts:
    """Where the numbers of a sequence came from."""
    manifest = sequence.manifest
    return SampleFacts(
        sequence=manifest.digest(),
        truth=manifest.files["cam0/truth.h5"].sha256,
        scene=scene_digest,
        renderer=manifest.renderer,
        sim=manifest.configuration,
        versions=manifest.versions,
        metrics=metric_versions(),
    )
