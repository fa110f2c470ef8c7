"""A stage beside the third one: depth maps of another method against ground truth."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.maps.folder import StoredWindow
from eventsweep.emvs.utils.inputs import check_file
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.jobs.job import RESULT, Runtime
from eventsweep.eval.results.results import DEFAULT_MAPPER, to_json
from eventsweep.eval.scoring.case import score_case
from eventsweep.eval.scoring.pairing import OF_ALL_METHODS, REFERENCE
from eventsweep.eval.scoring.predictions import Prediction, PredictionFacts, estimates_of
from eventsweep.eval.scoring.run_folder import target_view
from eventsweep.eval.stages.score import case_of

STAGE = __name__


def run(
    parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path, _runtime: Runtime
) -> None:
    """Scores the depth map of every window and all of them pooled, beside the reference method."""
    case, config = case_of(parameters, inputs[:-1]), EvalConfig.model_validate(parameters["score"])
    (windows,) = case.windows.values()
    only = {DEFAULT_MAPPER: [_reference_only(window) for window in windows]}
    prediction = opened(parameters, inputs[-1])
    views = [target_view(case.recording, window, config) for window in windows]
    estimates = (estimates_of([prediction], view) for view in views)
    scored = score_case(replace(case, windows=only), config, estimates)
    # `eval.stages.beside` compares all methods; here are but two of them.
    of_two = scored.rows["region"].isin(OF_ALL_METHODS)
    rows = scored.rows[(scored.rows["method"] == prediction.name) & ~of_two]
    (out / RESULT).write_text(to_json(replace(scored, rows=rows)), encoding="utf-8")


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
