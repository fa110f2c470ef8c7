"""The training set on disk: sequences, and samples of their windows; each is made once."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from eventsweep import scenes
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.processes import end_with_parent
from eventsweep.eval.jobs.code_version import closure, definition_digest
from eventsweep.eval.progress import Display
from eventsweep.plugins.learned.training.config import NetworkName, TrainingConfig
from eventsweep.plugins.learned.training.samples import SampleSet
from eventsweep.plugins.learned.training.sequences import Part, TrainingSequence, sequences
from eventsweep.plugins.learned.training.tasks import TASKS
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rigs import rig
from eventsweep.sim.sensor_presets import SensorConfig
from eventsweep.sim.simulate import simulate

PARTS: tuple[Part, ...] = ("training", "calibration")


def chosen(part: Part, config: TrainingConfig) -> tuple[TrainingSequence, ...]:
    """The sequences of a part, of the scenes that the configuration names."""
    known = {sequence.scene for sequence in sequences("training")}
    if unknown := set(config.scenes) - known:
        raise InputError(
            f"no training sequence of {', '.join(sorted(unknown))}: choose from "
            f"{', '.join(sorted(known))}"
        )
    wanted = config.scenes or known
    return tuple(sequence for sequence in sequences(part) if sequence.scene in wanted)


def code_digest(network: NetworkName) -> str:
    """A hash of the code that makes a network's samples: other code makes another training set."""
    return definition_digest(closure([TASKS[network].code]))


def make(folder: Path, config: TrainingConfig, progress: Display) -> None:
    """Simulates the sequences and draws samples of their windows, as far as they are not there."""
    wanted = [(part, sequence) for part in PARTS for sequence in chosen(part, config)]
    with progress.stage("sequences", len(wanted)) as update, _renderer() as renderer:
        for done, (_, sequence) in enumerate(wanted):
            update(done, sequence.name)
            path = folder / "sequences" / sequence.name
            if not path.exists():
                renderer.submit(simulate_sequence, sequence, path).result()
        update(len(wanted), f"{len(wanted)} sequences")
    with progress.stage("samples", len(wanted)) as update:
        for done, (part, sequence) in enumerate(wanted):
            update(done, sequence.name)
            _draw(folder, part, sequence, config)
        update(len(wanted), f"{len(wanted)} sequences")


def _renderer() -> ProcessPoolExecutor:
    """A process that renders: torch and a software renderer each bring an LLVM of their own."""
    start = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(1, mp_context=start, initializer=end_with_parent)


def simulate_sequence(spec: TrainingSequence, path: Path) -> None:
    """Simulates one sequence of the training set into a folder that is not there yet."""
    path.parent.mkdir(parents=True, exist_ok=True)
    config = SimConfig(duration_s=spec.seconds, sensor=SensorConfig(preset=spec.sensor))
    simulate(scenes.load(spec.scene), rig(spec.rig), config, spec.seed, path)


def _draw(folder: Path, part: Part, one: TrainingSequence, config: TrainingConfig) -> None:
    task = TASKS[config.network]
    for k, window in enumerate(task.windows(one)):
        path = folder / "samples" / part / f"{one.name}-{k}.npz"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            sequence = EventSequence.open(folder / "sequences" / one.name)
            task.draw(sequence, window, config.candidates).save(path)


def load(
    folder: Path,
    part: Part,
    config: TrainingConfig,
    among: Iterable[TrainingSequence] | None = None,
) -> SampleSet:
    """All samples of a part in one, or only those of the sequences `among`."""
    wanted = chosen(part, config) if among is None else among
    parts = list(_files(folder, part, config, wanted))
    if not sum(map(len, parts)):
        raise InputError(
            f"no {part} samples in {folder}: choose scenes that have sequences of both parts"
        )
    return TASKS[config.network].samples.joined(parts)


def _files(
    folder: Path, part: Part, config: TrainingConfig, wanted: Iterable[TrainingSequence]
) -> Iterator[SampleSet]:
    task = TASKS[config.network]
    for sequence in wanted:
        for k, _ in enumerate(task.windows(sequence)):
            found = task.samples.load(folder / "samples" / part / f"{sequence.name}-{k}.npz")
            rng = np.random.default_rng([sequence.seed, k])
            yield found[np.sort(rng.permutation(len(found))[: config.candidates])]
