"""Scores of a track against true poses, which the tracker never sees."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

from eventsweep.emvs.data.recording import Recording, events_span_us
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.config import TrajectoryConfig
from eventsweep.eval.found_poses import TRACK
from eventsweep.eval.report.html import Section, Sentences
from eventsweep.eval.report.trajectory_page import how, metrics_grid, notes, sentences
from eventsweep.eval.results.results import Results
from eventsweep.eval.scoring.trajectories.score import TrajectoryScore, results_of, score_poses
from eventsweep.eval.scoring.trajectories.sources import Source, read_truth

_CONFIG = TrajectoryConfig()
_RPE = "rpe_translation_"


class Judged(NamedTuple):
    """A track's score, or why it has none."""

    truth: Source | None
    found: TrajectoryScore | None
    why_not: str = ""

    def facts(self) -> dict[str, Any]:
        """Plain values; undefined numbers are None."""
        if self.truth is None or self.found is None:
            return {"not_scored": self.why_not}
        values = {
            name: None if math.isnan(value) else value for name, value in self.found.values.items()
        }
        return {"truth": str(self.truth.path), "values": values, "notes": list(self.found.notes)}

    def results(self, case: str) -> Results | None:
        """The scores as a table with provenance."""
        if self.truth is None or self.found is None:
            return None
        return results_of(case, {TRACK: self.found}, {"truth": self.truth.path.name})

    def lead(self) -> str:
        """The absolute error in a sentence, or why there is none."""
        if self.found is None:
            return f"Not scored: {self.why_not}."
        (sentence,) = sentences({TRACK: self.found})
        words = sentence.removeprefix(f"{TRACK}: ").split("; ")[0]
        return f"Against true poses, which the tracker did not see: {words}."

    def section(self) -> Section:
        """What the page says of it."""
        if self.found is None:
            return Section("score", "Score", (Sentences((f"Not scored: {self.why_not}.",)),))
        scored = {TRACK: self.found}
        said = (*sentences(scored), how(self.found))
        return Section(
            "score", "Score",
            (Sentences(said), Sentences(tuple(notes(scored)), "note"), metrics_grid(scored)),
        )  # fmt: skip

    def lines(self) -> list[str]:
        """What a terminal shows: absolute and relative errors."""
        if self.found is None:
            return [f"not scored: {self.why_not}"]
        steps = [
            f"{score.metric.removeprefix(_RPE).replace('pct', ' %')}: {100 * score.value:.3g} cm"
            for score in self.found.scores
            if score.metric.startswith(_RPE) and not math.isnan(score.value)
        ]
        said = [*sentences({TRACK: self.found}), f"RPE over {', '.join(steps) or 'no step'}"]
        return [*said, *(f"note: {note}" for note in self.found.notes)]


def true_poses(recording: Recording, path: Path, given: Path | None) -> Source | str:
    """True poses: those of a file or folder, else the recording's own, else what is missing.

    Raises:
        InputError: a given file that cannot be read, or lies outside the recording's time.
    """
    if given is None:
        try:
            return Source(recording.name, path, recording.trajectory)
        except InputError:  # its cure, poses that were found, would be compared with themselves
            return f"no true poses ({getattr(recording, 'poses', '') or 'the recording has none'})"
    truth = read_truth(given, _CONFIG)
    first_us, last_us = events_span_us(recording)
    begin_us, end_us = truth.trajectory.span_us
    if begin_us > last_us or end_us < first_us:
        raise InputError(
            f"{given}: poses from {begin_us / 1e6:.6f} to {end_us / 1e6:.6f} s, but events from "
            f"{first_us / 1e6:.6f} to {last_us / 1e6:.6f} s: needs poses on the events' clock"
        )
    return truth


def judged(estimate: Trajectory, truth: Source | str) -> Judged:
    """Scores a track, aligned rigidly, as `score` does by default."""
    if isinstance(truth, str):
        return Judged(None, None, truth)
    try:
        return Judged(truth, score_poses(truth.trajectory, estimate, _CONFIG))
    except InputError as error:
        return Judged(truth, None, str(error))
