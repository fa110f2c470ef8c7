"""The training set on disk: sequences, and samples of their windows; each is made once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.cache import Cache, default_cache
from eventsweep.emvs.utils.files import link_tree
from eventsweep.emvs.utils.outputs import atomic_dir
from eventsweep.eval.jobs.code_version import closure, definition_digest
from eventsweep.eval.jobs.job import SEQUENCE, Job, stored
from eventsweep.eval.jobs.local import default_workers, local_workers
from eventsweep.eval.jobs.scheduler import run_jobs
from eventsweep.eval.progress import Display
from eventsweep.eval.stages import simulate
from eventsweep.plugins.learned.training.config import NetworkName, TrainingConfig
from eventsweep.plugins.learned.training.samples import SampleSet
from eventsweep.plugins.learned.training.sequences import Part, TrainingSequence, sequences
from eventsweep.plugins.learned.training.tasks import TASKS

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
    simulated([sequence for _, sequence in wanted], folder / "sequences", progress)
    with progress.stage("samples", len(wanted)) as update:
        for done, (part, sequence) in enumerate(wanted):
            update(done, sequence.name)
            _draw(folder, part, sequence, config)
        update(len(wanted), f"{len(wanted)} sequences")


def simulated(wanted: Iterable[TrainingSequence], folder: Path, progress: Display) -> None:
    """Simulates sequences, each into a folder of its name, as far as they are not there.

    The jobs are those of suites, in processes of their own: torch and a software renderer each
    bring an LLVM.
    """
    store = Cache(default_cache())
    jobs = {one: _job(one) for one in wanted if not (folder / one.name).exists()}
    workers = partial(local_workers, default_workers(), store.folder)
    outcomes = run_jobs(jobs.values(), workers, progress)
    for sequence, job in jobs.items():
        outcome, made = outcomes[job.name], stored(job, store)
        if made is None:
            raise InputError(getattr(outcome, "reason", f"{job.name}: its sequence is gone"))
        with atomic_dir(folder / sequence.name, manifest=False) as place:
            link_tree(made.path / SEQUENCE, place)


def _job(one: TrainingSequence) -> Job:
    settings = {"duration_s": one.seconds, "sensor": {"preset": one.sensor}}
    facts = simulate.sequence_parameters(one.scene, one.rig, one.seed, settings)
    return Job(f"simulate/{one.name}", simulate.STAGE, facts)


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
