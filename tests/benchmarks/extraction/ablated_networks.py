"""The networks of the ablation: what each is not shown, and its training on a small budget."""

from __future__ import annotations

import json
import multiprocessing
import sys
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.processes import end_with_parent
from eventsweep.emvs.utils.release import install_extra
from eventsweep.eval.progress import Bars
from eventsweep.plugins.learned.networks import network
from eventsweep.plugins.learned.networks.network import CHANNELS, Float32s, Network
from eventsweep.plugins.learned.networks.weights import write_weights
from eventsweep.plugins.learned.training import data
from eventsweep.plugins.learned.training.config import TrainingConfig
from eventsweep.plugins.learned.training.samples import Samples
from eventsweep.plugins.learned.training.sequences import Part, TrainingSequence
from eventsweep.plugins.learned.training.tasks import TASKS
from eventsweep.sim.sensor_presets import PresetName

JUDGED = 200
"""Calibration samples of each window that the history of training is judged by."""


@dataclass(frozen=True)
class Budget:
    """What every network of the ablation is trained with.

    Attributes:
        candidates: samples of each window, if those of all sensors are taken.
        epochs: how often each is seen, if all are taken.
        batch: samples of one step.
    """

    candidates: int = 900
    epochs: int = 6
    batch: int = 256


@dataclass(frozen=True)
class Variant:
    """A network that lacks something.

    Attributes:
        name: of its file.
        title: in tables.
        hidden: channels that it never sees, in training and after.
        cues: whether it is told the numbers beside the votes.
        share: it learns from one in so many samples, each so many times as often.
        every: it learns from one in so many sequences, drawn at random; as many samples.
        sensors: those whose sequences it learns from; as many samples, too.
        seed: of weights, order and flips.
    """

    name: str
    title: str
    hidden: tuple[str, ...] = ()
    cues: bool = True
    share: int = 1
    every: int = 1
    sensors: tuple[PresetName, ...] = ("ideal", "davis346")
    seed: int = 0

    def sequences(self) -> tuple[TrainingSequence, ...]:
        """What it learns from."""
        known = data.chosen("training", TrainingConfig())
        drawn = sorted(np.random.default_rng(0).permutation(len(known))[:: self.every])
        return tuple(known[k] for k in drawn if known[k].sensor in self.sensors)

    def config(self, budget: Budget) -> TrainingConfig:
        """How it is trained: with as many samples and steps, from however few sequences."""
        every = len(data.chosen("training", TrainingConfig()))
        each = every / len(self.sequences()) / self.share
        return TrainingConfig(
            candidates=round(budget.candidates * each),
            epochs=budget.epochs * self.share,
            batch=budget.batch,
            seed=self.seed,
        )


VARIANTS = (
    Variant("base", "on a small budget"),
    Variant("seed", "the same, another seed", seed=1),
    Variant("fused", "without the cameras' channels", hidden=CHANNELS[1:]),
    Variant("votes", "without the thirteen numbers", cues=False),
    Variant("quarter", "from a quarter of the samples", share=4),
    Variant("sequences", "from a quarter of the sequences", share=4, every=4),
    Variant("ideal", "without noisy sensors", sensors=("ideal",)),
)


@dataclass(frozen=True, eq=False)
class Masked(Network):
    """A network that is shown what it was shown in training.

    Attributes:
        variant: which network it is.
    """

    variant: Variant = VARIANTS[0]

    def judge(self, shares: Float32s, cues: Float32s) -> tuple[Float32s, Float32s]:
        """As any network, but for what is hidden."""
        shown = shares.copy()
        shown[:, _hidden(self.variant)] = 0
        return super().judge(shown, cues if self.variant.cues else np.zeros_like(cues))


def masked(samples: Samples, variant: Variant) -> Samples:
    """Samples without what is hidden from a network; a code of 0 is a share of 0."""
    codes = samples.codes.copy()
    codes[:, _hidden(variant)] = 0
    cues = samples.cues if variant.cues else np.zeros_like(samples.cues)
    return replace(samples, codes=codes, cues=cues)


def _hidden(variant: Variant) -> list[int]:
    return [CHANNELS.index(name) for name in variant.hidden]


def trained(folder: Path, variant: Variant, budget: Budget) -> Masked | None:
    """The network that was trained in a folder; None where it was not.

    Raises:
        InputError: weights that cannot be read, or were trained in another way.
    """
    path = _path(folder, variant, budget)
    if not path.exists():
        return None
    weights = network.network(path).weights
    if weights.manifest.get("ablation") != _asked(variant, budget):
        raise InputError(f"{path}: trained in another way; choose another folder, or delete it")
    return Masked(weights, variant=variant)


def _path(folder: Path, variant: Variant, budget: Budget) -> Path:
    """Of a network's weights: other budgets have other files."""
    return folder / f"{variant.name}-{budget.candidates}x{budget.epochs}x{budget.batch}.npz"


def _asked(variant: Variant, budget: Budget) -> Mapping[str, Any]:
    """What decides the weights, as manifests hold it."""
    lacks = {name: value for name, value in asdict(variant).items() if name != "title"}
    plain: Mapping[str, Any] = json.loads(json.dumps({**lacks, **asdict(budget)}))
    return plain


def train_missing(folder: Path, samples: Path | None, budget: Budget) -> bool:
    """Trains every network that a folder lacks.

    Args:
        folder: of the networks; made here.
        samples: where `eventsweep train` made samples; None: nothing is trained.
        budget: of each training.

    Returns:
        Whether all are there; where they are not, one line on the error stream says why.
    """
    missing = [one for one in VARIANTS if trained(folder, one, budget) is None]
    if not missing:
        return True
    if samples is None or find_spec("torch") is None:
        names = ", ".join(one.name for one in missing)
        sys.stderr.write(f"{folder}: not trained yet: {names}; {_needed(samples)}\n")
        return False
    folder.mkdir(parents=True, exist_ok=True)
    start = multiprocessing.get_context("spawn")
    # Torch in a process of its own: it and a software renderer crash each other.
    with ProcessPoolExecutor(1, mp_context=start, initializer=end_with_parent) as apart:
        for variant in missing:
            apart.submit(train, folder, variant, samples, budget).result()
    return True


def _needed(samples: Path | None) -> str:
    if samples is None:
        return "say --samples FOLDER, of a finished `eventsweep train --out FOLDER`"
    return f"training needs torch, which is not installed: {install_extra('train')}"


def train(folder: Path, variant: Variant, samples: Path, budget: Budget) -> None:
    """Trains one network and writes its weights; a stopped run goes on after its last epoch.

    Raises:
        InputError: no samples there.
    """
    from eventsweep.plugins.learned.training.fit import Fitting

    config = variant.config(budget)
    training = masked(_read(samples, "training", config, variant.sequences()), variant)
    few = config.model_copy(update={"candidates": JUDGED})
    calibration = masked(_read(samples, "calibration", few), variant)
    path = _path(folder, variant, budget)
    fitting = Fitting(config, training, calibration, path.with_suffix(".pt"))
    with Bars().stage(variant.name, config.epochs) as update:
        fitting.run(update)
        update(config.epochs, f"loss {fitting.history[-1]['loss']:.3f}")
    learnt = {
        "ablation": _asked(variant, budget),
        "training": config.model_dump(mode="json"),
        "samples": len(training),
        "history": fitting.history,
    }
    write_weights(path, TASKS[config.network].name, fitting.network.arrays(), learnt)


def _read(
    folder: Path,
    part: Part,
    config: TrainingConfig,
    among: Iterable[TrainingSequence] | None = None,
) -> Samples:
    try:
        found = data.load(folder, part, config, among)
    except FileNotFoundError as error:
        raise InputError(
            f"{error.filename}: no such samples; make them with `eventsweep train --out FOLDER`"
        ) from error
    assert isinstance(found, Samples)
    return found
