"""A stage behind the first one: a sequence as its mapper is given it, for programs of others.

Imperfect geometry is in it, ground truth is not, nor the seed, nor what made each event.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep.emvs.data.recording import Recording, events_span_us
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.datasets import open_recording
from eventsweep.eval.jobs.job import SEQUENCE, Runtime
from eventsweep.eval.stages.map import as_perturbed

_STEP_US = 50_000


def run(
    parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path, _runtime: Runtime
) -> None:
    """Writes what `perturb` makes of a sequence, under the number that stands for its seed."""
    recording = as_perturbed(open_recording(inputs[0] / SEQUENCE), parameters)
    write_perturbed(recording, int(parameters["seed"]), out / SEQUENCE)


def write_perturbed(recording: Recording, number: int, out: Path) -> None:
    """Writes events, calibration and poses of a recording as a sequence, and nothing else."""
    first_us, last_us = events_span_us(recording)
    with SequenceWriter(
        out,
        name=recording.name,
        rig=recording.rig,
        trajectory=recording.trajectory,
        config={},
        seed=number,
        depth_range_m=recording.depth_range_m,
        span_us=(first_us, last_us),
    ) as writer:
        for camera in range(len(recording.rig)):
            for start_us in range(first_us, last_us + 1, _STEP_US):
                end_us = min(start_us + _STEP_US, last_us + 1)
                writer.append_events(camera, recording.events(camera, start_us, end_us))
