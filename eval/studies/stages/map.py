"""The second stage of a study's jobs: a perturbed sequence to the depth maps of all methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from emvs.datasets import open_recording
from eval.jobs.job import SEQUENCE
from eval.studies.perturb import Perturbation, PerturbedRecording
from eval.suite.stages.map import map_one_window


def code(parameters: Mapping[str, Any]) -> tuple[Sequence[str], Sequence[Path]]:
    """Nothing beside what this module imports."""
    del parameters
    return (), ()


def run(parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path) -> None:
    """Maps the perturbed recording."""
    perturbation = Perturbation.model_validate(parameters["perturb"])
    recording = PerturbedRecording(
        open_recording(inputs[0] / SEQUENCE), perturbation, parameters["seed"]
    )
    map_one_window(recording, parameters, out)
