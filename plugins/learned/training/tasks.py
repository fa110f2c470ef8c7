"""The networks that can be trained: what each learns from, and where its weights go."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.plugins.learned.networks import derd, network
from eventsweep.plugins.learned.training.config import NetworkName, TrainingConfig
from eventsweep.plugins.learned.training.samples import (
    DerdSamples,
    Samples,
    SampleSet,
    derd_samples,
    derd_windows,
    samples,
)
from eventsweep.plugins.learned.training.sequences import TrainingSequence, TrainingWindow, windows


@dataclass(frozen=True)
class Task:
    """One network to train.

    Attributes:
        name: of the network in manifests.
        compared: what its errors stand beside, in a word.
        methods: those whose expected error is calibrated; empty where it expects none.
        draw: the samples of one window, at most so many.
        facts: what its manifest says beside.
    """

    title: str
    name: str
    weights_name: str
    compared: str
    methods: tuple[str, ...]
    samples: type[SampleSet]
    windows: Callable[[TrainingSequence], tuple[TrainingWindow, ...]]
    draw: Callable[[EventSequence, TrainingWindow, int], SampleSet]
    facts: Callable[[TrainingConfig], Mapping[str, Any]] = lambda _: {}

    @property
    def code(self) -> str:
        """The module that makes its samples."""
        return self.draw.__module__


TASKS: dict[NetworkName, Task] = {
    "learned": Task(
        "the learned extraction", network.NAME, "learned.npz", "focus",
        ("Learned/H", "Learned/cam0"), Samples, windows, samples,
    ),
    "derd": Task(
        "DERD-Net", derd.NAME, "derd.npz", "votes", (), DerdSamples, derd_windows, derd_samples,
        lambda config: {"uniform_in": config.uniform_in},
    ),
}  # fmt: skip
