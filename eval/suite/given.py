"""A case whose sequence is given: a recording with truth as a folder, beside simulated cases.

As a job it takes the place of the simulator. Every seed has the same sequence.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep.emvs.data.manifest import FILE_NAME
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.output_manifest import hashed
from eventsweep.eval.jobs.job import SEQUENCE, Job, Runtime

STAGE = __name__


def is_given(scene: str) -> bool:
    """Whether a case's scene is the folder of a sequence."""
    return "/" in scene and (Path(scene) / FILE_NAME).is_file()


def given(scene: str) -> EventSequence:
    """The sequence of a case.

    Raises:
        InputError: a damaged one, or one without poses or depth.
    """
    sequence = EventSequence.open(scene)
    if not sequence.has_poses or not len(sequence.truth_times_us(0)):
        raise InputError(f"{scene}: has no true poses or depth: a case needs both")
    if sequence.manifest.depth_range_m is None:
        raise InputError(f"{scene}: states no range of depth: a case needs it")
    return sequence


def given_job(case: str, scene: str) -> tuple[Job, str]:
    """The job that copies the sequence of a case, and its hash, in the place of the scene's."""
    manifest = given(scene).manifest
    own = hashed(Path(scene) / FILE_NAME).sha256
    files = {FILE_NAME: own, **{name: entry.sha256 for name, entry in manifest.files.items()}}
    job = Job(f"given/{case}", STAGE, {"files": files}, (), (str(Path(scene).resolve()),))
    return job, manifest.digest()


def run(
    parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path, _runtime: Runtime
) -> None:
    """Copies the files that `files` lists, each of the hash that it says."""
    (out / SEQUENCE).mkdir()
    for name, sha256 in parameters["files"].items():
        place = out / SEQUENCE / name
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(inputs[0] / name, place)
        if hashed(place).sha256 != sha256:
            raise InputError(f"{inputs[0] / name}: changed since it was made: make it again")
