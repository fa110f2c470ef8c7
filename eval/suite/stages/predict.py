"""A stage beside the third one: depth maps of another method against ground truth."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.maps.folder import StoredWindow
from eventsweep.emvs.utils.inputs import check_file
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.jobs.job import RESULT, SEQUENCE
from eventsweep.eval.scoring.pairing import REFERENCE
from eventsweep.eval.scoring.predictions import Prediction, PredictionFacts, estimates_of
from eventsweep.eval.scoring.run_folder import target_view
from eventsweep.eval.scoring.score import score_windows
from eventsweep.eval.suite.results import Sample, sample_text
from eventsweep.eval.suite.stages.score import mapped_window, sample_facts


def run(parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path) -> None:
    """Scores the depth map of every window and all of them pooled, beside the reference method."""
    case, config = str(parameters["case"]), EvalConfig.model_validate(parameters["score"])
    sequence = EventSequence.open(inputs[0] / SEQUENCE)
    windows = [_reference_only(mapped_window(path)) for path in inputs[1:-1]]
    prediction = opened(parameters, inputs[-1])
    views = [target_view(sequence, window, config) for window in windows]
    estimates = (estimates_of([prediction], view) for view in views)
    scored = score_windows(case, sequence, windows, config, estimates, REFERENCE)
    rows = scored[scored["method"] == prediction.name]
    facts = sample_facts(sequence, str(parameters["scene_digest"]))
    sample = Sample(case, int(parameters["seed"]), facts)
    (out / RESULT).write_text(sample_text(sample, rows), encoding="utf-8")


def opened(parameters: Mapping[str, Any], folder: Path) -> Prediction:
    """The depth maps that a job was planned with; none may be gone or another one."""
    files = {int(t_us): folder / name for t_us, (name, _) in parameters["files"].items()}
    for t_us, (_, sha256) in parameters["files"].items():
        _check_unchanged(files[int(t_us)], sha256)
    description = PredictionFacts.model_validate(parameters["description"])
    # Files are under the views' own times already.
    exact = description.model_copy(update={"tolerance_us": 0})
    return Prediction(str(parameters["name"]), files, exact)


def _check_unchanged(path: Path, sha256: str) -> None:
    try:
        check_file(path)
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}): it must be there for all workers"
        ) from error
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(f"{path}: was changed while the suite ran: run it again")


def _reference_only(window: StoredWindow) -> StoredWindow:
    methods = window.info.methods
    kept = REFERENCE if REFERENCE in methods else methods[0]
    return StoredWindow(window.path, window.info.model_copy(update={"methods": (kept,)}))
