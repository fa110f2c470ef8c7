"""What the learned extraction is trained on: motions that no suite and no study ever scores.

Scenes are those of the benchmark, motions are not: seeds of training begin at `FIRST_SEED`, far
above every seed of a suite or a study, and a test keeps the two lists disjoint.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from eventsweep.sim.sensor_presets import PresetName

FIRST_SEED = 1000
Part = Literal["training", "calibration"]
_SECONDS = 0.5
_TRUTH_STEP_S = 0.05  # that of sequences: reference times lie on it


@dataclass(frozen=True)
class TrainingSequence:
    """One sequence to simulate; its seed is `FIRST_SEED` or more."""

    scene: str
    rig: str
    seed: int
    sensor: PresetName = "ideal"
    seconds: float = _SECONDS

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.scene}-{self.rig}-{self.seconds:g}s-{self.sensor}-seed{self.seed}"


@dataclass(frozen=True)
class TrainingWindow:
    """One window of a sequence, and the errors of what the mapper reads.

    Attributes:
        imperfection: amounts of `eval.perturbations.Perturbation`; empty: exact geometry.
        fusion: how votes are fused, or which camera is alone: what follows the slash of a method.
        seed: of what is drawn at random in it.
    """

    start_s: float
    duration_s: float
    planes: int = 100
    imperfection: dict[str, Any] = field(default_factory=dict)
    fusion: str = "H"
    seed: int = 0


_OWN_RIGS = {
    "rpg-boxes": "rpg", "rpg-reader": "rpg", "rpg-monitor": "rpg", "rpg-bin": "rpg",
    "mvsec-flying": "mvsec", "trinocular-desk": "trinocular",
}  # fmt: skip
_SCENES = (
    "planes", "desk", "boxes", "rpg-boxes", "rpg-reader", "rpg-monitor", "rpg-bin", "mvsec-flying",
    "tumvie-6dof", "tumvie-desk2", "tumvie-1d", "tumvie-3d", "hdr-window", "hdr-night",
    "moving-objects", "low-texture", "repetitive", "thin-structures", "reflective",
    "trinocular-desk", "tumvie-run", "tumvie-skate", "tumvie-bike", "dsec-street",
)  # fmt: skip
_OTHER_RIGS = ("davis346", "mvsec", "rpg")
_OTHER_FUSIONS = ("cam0", "cam0", "cam1", "min", "G", "A", "RMS", "max")


def sequences(part: Part) -> tuple[TrainingSequence, ...]:
    """The sequences that train the network, or those that calibrate what it says of itself."""
    if part == "calibration":
        return tuple(_calibration())
    return (*_each_scene(), *_wide())


def _each_scene() -> Iterator[TrainingSequence]:
    """Every scene twice: its own rig and an ideal sensor; another rig and a noisy one."""
    for k, scene in enumerate(_SCENES):
        yield TrainingSequence(scene, _OWN_RIGS.get(scene, "davis346"), FIRST_SEED + k)
        other = "trinocular" if scene == "trinocular-desk" else _OTHER_RIGS[k % len(_OTHER_RIGS)]
        yield TrainingSequence(scene, other, FIRST_SEED + 100 + k, "davis346")


def _wide() -> Iterator[TrainingSequence]:
    """Sensors of many pixels, shortly, where planes are far apart; and long windows."""
    yield TrainingSequence("dsec-street", "dsec", FIRST_SEED + 200, seconds=0.1)
    yield TrainingSequence("tumvie-3d", "tumvie-kb4", FIRST_SEED + 201, seconds=0.1)
    yield TrainingSequence("desk", "tumvie", FIRST_SEED + 202, seconds=0.1)
    for k, scene in enumerate(("boxes", "rpg-reader", "mvsec-flying", "low-texture")):
        rig = _OWN_RIGS.get(scene, "davis346")
        yield TrainingSequence(scene, rig, FIRST_SEED + 210 + k, "davis346", 1.0)


def _calibration() -> Iterator[TrainingSequence]:
    """Other motions again, ideal and noisy in turn."""
    for k, scene in enumerate(_SCENES[::2]):
        sensor: PresetName = "davis346" if k % 2 else "ideal"
        rig = _OWN_RIGS.get(scene, "davis346")
        yield TrainingSequence(scene, rig, FIRST_SEED + 300 + k, sensor)


def windows(sequence: TrainingSequence) -> tuple[TrainingWindow, ...]:
    """The windows of a sequence: all of it, a part, a part with errors, a part fused otherwise."""
    rng = np.random.default_rng([sequence.seed, 0x1EA4])
    whole = TrainingWindow(0.0, sequence.seconds, seed=sequence.seed)
    part = _part(rng, sequence, planes=int(rng.choice([60, 100, 160])))
    wrong = _part(rng, sequence, planes=100, imperfection=_imperfection(rng))
    other = _part(rng, sequence, planes=100, fusion=str(rng.choice(_OTHER_FUSIONS)))
    return whole, part, wrong, other


def _part(
    rng: np.random.Generator, sequence: TrainingSequence, *, planes: int, **more: Any
) -> TrainingWindow:
    """A stretch of 0.1 s or more whose middle has ground truth."""
    steps = round(sequence.seconds / _TRUTH_STEP_S)
    half = int(rng.integers(1, max(steps // 2, 1) + 1))
    middle = int(rng.integers(half, steps - half + 1))
    start_s, duration_s = (middle - half) * _TRUTH_STEP_S, 2 * half * _TRUTH_STEP_S
    seed = int(rng.integers(2**31))
    return TrainingWindow(round(start_s, 3), round(duration_s, 3), planes, seed=seed, **more)


def _imperfection(rng: np.random.Generator) -> dict[str, Any]:
    """Errors of calibration and poses as recordings have them, of sizes from none up."""
    size = rng.uniform(0, 1.5, 6)
    return {
        "focal_percent": float(rng.choice([-1, 1]) * size[0]),
        "pose_walk_mm": 9 * float(size[1]),
        "pose_walk_deg": 0.9 * float(size[1]),
        "stereo_yaw_deg": float(rng.choice([-1, 1]) * 0.05 * size[2]),
        "stereo_pitch_deg": float(rng.choice([-1, 1]) * 0.05 * size[3]),
        "camera_delay_ms": float(rng.choice([-1, 1]) * size[4]),
        "drift_percent": float(2 * size[5]),
    }
