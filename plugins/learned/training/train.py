"""Trains a network: sequences, samples, epochs, weights."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import write_text
from eventsweep.emvs.utils.inputs import SETTINGS_BYTES, parse_json, read_text
from eventsweep.emvs.utils.release import install_extra
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.progress import Display
from eventsweep.plugins.learned.networks.weights import write_weights
from eventsweep.plugins.learned.training import confidence, data
from eventsweep.plugins.learned.training.config import History, TrainingConfig
from eventsweep.plugins.learned.training.tasks import TASKS, Task

if TYPE_CHECKING:
    from eventsweep.plugins.learned.training.fit import Fitting

ASKED_NAME = "training.json"
CHECKPOINT_NAME = "checkpoint.pt"
LICENCE = "MIT"


@dataclass(frozen=True)
class Trained:
    """The result of training: weights, their manifest, and the numbers of every epoch."""

    task: Task
    weights: Path
    history: History
    manifest: Mapping[str, Any]


def train(folder: Path, config: TrainingConfig, progress: Display) -> Trained:
    """Trains a network; what is there already from an earlier, stopped run is not done again."""
    Fitted = _fitting()
    _same_training(folder, config)
    data.make(folder, config, progress)
    training, calibration = (data.load(folder, part, config) for part in data.PARTS)
    fitting = Fitted(config, training, calibration, folder / CHECKPOINT_NAME)
    with progress.stage("epochs", config.epochs) as update:
        fitting.run(update)
        update(config.epochs, f"loss {fitting.history[-1]['loss']:.3f}")
    task, arrays = TASKS[config.network], fitting.network.arrays()
    learnt = manifest(config, fitting.history, len(training), len(calibration))
    weights = folder / task.weights_name
    write_weights(weights, task.name, arrays, learnt)
    if task.methods:
        with progress.stage("reliability", 1) as update:
            learnt["precision"] = _precision(folder, config, weights)
            write_weights(weights, task.name, arrays, learnt)
            update(1, f"{len(learnt['precision'])} tables")
    return Trained(task, weights, fitting.history, learnt)


def _precision(folder: Path, config: TrainingConfig, weights: Path) -> dict[str, Any]:
    specs, methods = data.chosen("calibration", config), TASKS[config.network].methods
    points = confidence.collect(folder / "sequences", specs, methods, weights)
    return {name: confidence.fit(own).to_json() for name, own in points.items()}


def _fitting() -> type[Fitting]:
    try:
        from eventsweep.plugins.learned.training.fit import Fitting
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise InputError(
            f"training needs torch, which is not installed: {install_extra('train')}"
        ) from error
    return Fitting


def _same_training(folder: Path, config: TrainingConfig) -> None:
    """Notes what is trained here; refuses a folder in which it was something else."""
    asked = {"config": config.model_dump(mode="json"), "code": data.code_digest(config.network)}
    path = folder / ASKED_NAME
    if path.exists():
        before = parse_json(read_text(path, SETTINGS_BYTES))
        if before != asked:
            differing = _differing(before, asked)
            raise InputError(
                f"{folder}: something else was trained here ({differing}); choose another folder"
            )
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: is not empty, and nothing was trained here; choose another")
    folder.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(asked, indent=1) + "\n")


def _differing(before: Any, asked: dict[str, Any]) -> str:
    config = before.get("config", {}) if isinstance(before, dict) else {}
    names = [name for name, value in asked["config"].items() if config.get(name) != value]
    return f"another {', '.join(names)}" if names else "by other code"


def manifest(
    config: TrainingConfig, history: History, training: int, calibration: int
) -> dict[str, Any]:
    """What the weights' manifest says of how they were learnt."""
    sets = {part: data.chosen(part, config) for part in data.PARTS}
    return {
        "licence": LICENCE,
        **TASKS[config.network].facts(config),
        "training": config.model_dump(mode="json"),
        "code": data.code_digest(config.network),
        "versions": versions(),
        "samples": {"training": training, "calibration": calibration},
        "sequences": {part: [one.name for one in chosen] for part, chosen in sets.items()},
        "scenes": dict(sorted(Counter(one.scene for one in sets["training"]).items())),
        "calibration_errors": history[-1],
    }
