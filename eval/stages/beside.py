"""A stage beside the third one: all methods of a window on the same pixels, at as many points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep.eval.config import EvalConfig
from eventsweep.eval.jobs.job import RESULT, Runtime
from eventsweep.eval.results.results import Results, mapper_method, to_json
from eventsweep.eval.scoring.case import CaseMaps, sample_of
from eventsweep.eval.scoring.metric_versions import metric_versions
from eventsweep.eval.scoring.pairing import OF_ALL_METHODS, MethodPairs, pair_methods
from eventsweep.eval.scoring.predictions import Prediction, estimates_of
from eventsweep.eval.scoring.run_folder import target_view, truth_of
from eventsweep.eval.scoring.score import case_rows, map_estimates
from eventsweep.eval.stages.predict import opened
from eventsweep.eval.stages.score import case_of

STAGE = __name__


def run(
    parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path, _runtime: Runtime
) -> None:
    """Scores the first mapper's maps and all predictions on the pixels that they compare on."""
    theirs: list[Mapping[str, Any]] = parameters["predictions"]
    count = len(inputs) - len(theirs)
    case = case_of(parameters, inputs[:count])
    config = EvalConfig.model_validate(parameters["score"])
    predictions = [opened(*one) for one in zip(theirs, inputs[count:], strict=True)]
    rows = case_rows(case.name, _pairs(case, predictions, config))
    rows = rows[rows["region"].isin(OF_ALL_METHODS)]
    given = {prediction.name for prediction in predictions}
    names = [m if m in given else mapper_method(m, parameters["mapper"]) for m in rows["method"]]
    scored = Results(rows.assign(method=names), {}, (sample_of(case, metric_versions()),))
    (out / RESULT).write_text(to_json(scored), encoding="utf-8")


def _pairs(
    case: CaseMaps, predictions: Sequence[Prediction], config: EvalConfig
) -> Iterator[tuple[str, dict[str, MethodPairs]]]:
    (windows,) = case.windows.values()
    for window in windows:
        truth = truth_of(case.recording, window.info.t_ref_us, config)
        maps = {name: window.depth_map(name) for name in window.info.methods}
        view = target_view(case.recording, window, config)
        estimates = map_estimates(maps) | estimates_of(predictions, view)
        yield window.info.name, pair_methods(estimates, truth)
