"""The second stage of a study's jobs: a perturbed sequence to the depth maps of all methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from emvs.datasets import open_recording
from eval.jobs.job import SEQUENCE
from eval.perturbations import Perturbation, perturbed
from eval.suite.stages.map import code as method_packages
from eval.suite.stages.map import map_one_window


def code(parameters: Mapping[str, Any]) -> tuple[Sequence[str], Sequence[Path]]:
    """The packages of others that its methods come from."""
    return method_packages(parameters)


def run(parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path) -> None:
    """Maps the perturbed recording."""
    amount = Perturbation.model_validate(parameters["perturb"])
    recording = open_recording(inputs[0] / SEQUENCE)
    map_one_window(perturbed(recording, amount, parameters["seed"]), parameters, out)
