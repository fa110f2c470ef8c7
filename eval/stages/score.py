"""The third stage: the depth maps of one sequence against ground truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.maps.folder import StoredWindow, read_map
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.jobs.job import RESULT, SEQUENCE, Runtime
from eventsweep.eval.results.results import DEFAULT_MAPPER, to_json
from eventsweep.eval.scoring.case import CaseMaps, score_case
from eventsweep.eval.scoring.run_folder import MAP_FOLDER, mapped_window, tracked_in

STAGE = __name__


def run(
    parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path, _runtime: Runtime
) -> None:
    """Scores a suite's case, or with `of_run` a run's; what is scored lies in the jobs' folders.

    With `track` the last input is what that stage made: its poses and maps are scored, too.
    """
    config = EvalConfig.model_validate(parameters["score"])
    case = case_of(parameters, inputs)
    scored = score_case(case, config, in_suite=not parameters.get("of_run"))
    (out / RESULT).write_text(to_json(scored), encoding="utf-8")


def case_of(parameters: Mapping[str, Any], inputs: Sequence[Path]) -> CaseMaps:
    """What the folders of a scoring job's inputs hold: a sequence, maps and found poses."""
    name, scene = str(parameters["case"]), str(parameters["scene_digest"])
    sequence, mappers = EventSequence.open(inputs[0] / SEQUENCE), parameters["mappers"]
    tracked = inputs[-1] if parameters.get("track") else None
    if parameters.get("of_run"):
        found = None if tracked is None else tracked_in(tracked, DEFAULT_MAPPER)
        return CaseMaps.of_map(name, sequence, read_map(inputs[1] / MAP_FOLDER), found, scene)
    windows: dict[str, list[StoredWindow]] = {}
    for mapper, made in zip(mappers, inputs[1 : 1 + len(mappers)], strict=True):
        windows.setdefault(mapper, []).append(mapped_window(made))
    if tracked is None:
        return CaseMaps(name, sequence, windows, scene=scene)
    own = {mapper: tracked_in(tracked, mapper) for mapper in windows}
    maps, poses = {m: found.map for m, found in own.items()}, next(iter(own.values())).poses
    return CaseMaps(name, sequence, windows, maps, poses, scene=scene)
