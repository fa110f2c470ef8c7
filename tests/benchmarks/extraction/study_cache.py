"""Simulated sequences of the extraction study and their volumes, each made once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep import scenes
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.reference_view import ReferenceView, reference_view
from eventsweep.emvs.utils.outputs import atomic_dir
from eventsweep.emvs.windows import choose_window
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.scoring.pairing import Truth
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rigs import rig as named_rig
from eventsweep.sim.sensor_presets import PresetName, SensorConfig
from eventsweep.sim.simulate import simulate


@dataclass(frozen=True, eq=False)
class StudySample:
    """One simulated window: what the cameras voted, and what is true.

    Attributes:
        case: scene.
        seed: seed of the head motion.
        votes: (C, N, H, W) float32 votes of each camera, planes near to far.
        view: the reference view.
        truth: ground truth there.
    """

    case: str
    seed: int
    votes: NDArray[np.float32]
    view: ReferenceView
    truth: Truth


def load_sample(
    case: str,
    seed: int,
    cache: Path,
    config: MapperConfig,
    *,
    rig: str,
    seconds: float,
    sensor: PresetName = "ideal",
) -> StudySample:
    """Returns one sample, simulated and swept on the first call and read on every later one.

    Args:
        case: name of a scene.
        seed: seed of the head motion.
        cache: folder of sequences and volumes; made here, safe to delete.
        config: planes of the volumes.
        rig: name of the rig.
        seconds: length of the sequence, s.
        sensor: preset of the simulated sensor.

    Raises:
        InputError: an unknown case or rig, or what the simulator refuses.
    """
    sequence = load_sequence(case, seed, cache, rig=rig, seconds=seconds, sensor=sensor)
    window = choose_window(sequence, config)
    view = reference_view(sequence, config, window.t_ref_us)
    volumes = cache / f"{sequence.path.name}-{config.planes}planes"
    if not volumes.exists():
        _sweep(sequence, config, volumes)
    votes = np.stack([np.load(path) for path in sorted(volumes.glob("EMVS-cam*.npy"))])
    return StudySample(case, seed, votes, view, truth_of(sequence, window.t_ref_us, EvalConfig()))


def load_sequence(
    case: str, seed: int, cache: Path, *, rig: str, seconds: float, sensor: PresetName = "ideal"
) -> EventSequence:
    """Returns the sequence of one sample, simulated on the first call; arguments as above.

    Raises:
        InputError: an unknown case or rig, or what the simulator refuses.
    """
    name = f"{case}-{rig}-{seconds:g}s-seed{seed}" + ("" if sensor == "ideal" else f"-{sensor}")
    path = cache / name
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        asked = SimConfig(duration_s=seconds, sensor=SensorConfig(preset=sensor))
        simulate(scenes.load(case), named_rig(rig), asked, seed, path)
    sequence = open_recording(path)
    if not isinstance(sequence, EventSequence):
        raise InputError(f"{path}: no simulated sequence; delete it to make it again")
    return sequence


def _sweep(sequence: EventSequence, config: MapperConfig, out: Path) -> None:
    single = tuple(f"EMVS/cam{camera}" for camera in range(len(sequence.rig)))
    asked = config.model_copy(update={"methods": single, "save_dsi": True})
    with atomic_dir(out) as folder:
        map_window(sequence, asked, dsi_dir=folder)
