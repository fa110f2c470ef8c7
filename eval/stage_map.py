"""The second stage of a suite's jobs: one window of a sequence to the depth maps of all methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.io import open_recording
from emvs.mapper import map_window
from emvs.output import write_window
from eval import stage_window
from eval.stage_files import SEQUENCE


def code(parameters: Mapping[str, Any]) -> tuple[Sequence[str], Sequence[Path]]:
    """Nothing beside what this module imports."""
    del parameters
    return (), ()


def run(parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path) -> None:
    """Maps with one thread: the results do not depend on how many, and other jobs have the rest."""
    map_into(open_recording(inputs[0] / SEQUENCE), parameters, out)


def map_into(recording: Recording, parameters: Mapping[str, Any], out: Path) -> None:
    """Maps one window of a recording as `map` says and writes it under the name `window`."""
    config = MapperConfig.model_validate(parameters["map"])
    result = map_window(recording, config.model_copy(update={"threads": 1}))
    name = str(parameters["window"])
    info = write_window(out / name, result, config, recording.rig.camera_names, clouds=False)
    stage_window.write(out, info)
