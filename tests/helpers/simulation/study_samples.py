"""The simulated samples of the extraction study: those that chose, and those kept apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from eventsweep.emvs.errors import InputError
from eventsweep.sim.sensor_presets import PresetName


@dataclass(frozen=True)
class SampleSpec:
    """One sample to simulate.

    Attributes:
        case: scene.
        rig: name of the rig.
        seconds: length, s.
        seed: seed of the head motion.
        sensor: preset of the simulated sensor.
    """

    case: str
    rig: str = "davis346"
    seconds: float = 0.5
    seed: int = 0
    sensor: PresetName = "ideal"


_FIRST = ("planes", "desk", "boxes")
_RIGS = {
    "rpg-boxes": "rpg", "rpg-reader": "rpg", "rpg-monitor": "rpg", "rpg-bin": "rpg",
    "mvsec-flying": "mvsec", "trinocular-desk": "trinocular",
}  # fmt: skip
"""Of the other cases it is the default."""
_TWINS = (
    "rpg-boxes", "rpg-reader", "rpg-monitor", "rpg-bin", "mvsec-flying", "tumvie-6dof",
    "tumvie-desk2", "tumvie-1d", "tumvie-3d", "hdr-window", "hdr-night", "moving-objects",
    "low-texture", "repetitive", "thin-structures", "reflective", "trinocular-desk",
)  # fmt: skip


def _each(*cases: str, seed: int = 0) -> tuple[SampleSpec, ...]:
    """One motion through every case."""
    return tuple(SampleSpec(case, _RIGS.get(case, "davis346"), seed=seed) for case in cases)


# Chose the parameters and the reliability: one motion through every scene
DEVELOPMENT = _each(*_FIRST, *_TWINS)
# Took part in choosing too: other motions, of going forward as well
FURTHER = (
    *_each(*_FIRST, "tumvie-run", "tumvie-skate", seed=1),
    *_each("low-texture", "thin-structures", "tumvie-1d", "tumvie-3d", "hdr-window", seed=2),
    *_each(*_FIRST, "low-texture", "moving-objects", "repetitive", seed=5),
    *_each(*_TWINS[:9], seed=5),
)
# Looked at once, by the command that writes the tables: other motions through the scenes
HELD_OUT = (
    *(sample for case in _FIRST for seed in (2, 3) for sample in _each(case, seed=seed)),
    *_each(*_TWINS, seed=1),
)
# Going forward, a street, and sensors of 640x480 and 1280x720: nothing was chosen on these
OTHERS = (
    *_each("tumvie-run", "tumvie-skate", "tumvie-bike"),
    SampleSpec("dsec-street", "dsec", 0.2),
    SampleSpec("tumvie-3d", "tumvie-kb4", 0.2),
)
# A sensor that is not ideal: nothing was chosen on these either
NOISY = tuple(
    SampleSpec(case, sensor="davis346") for case in (*_FIRST, "tumvie-6dof", "reflective")
)
# Scenes that can be left out of training: the held-out motions through them
_LEFT_OUT = (
    "rpg-boxes", "rpg-reader", "rpg-monitor", "rpg-bin", "tumvie-6dof", "tumvie-desk2", "tumvie-1d",
    "tumvie-3d", "hdr-night", "low-texture", "thin-structures",
)  # fmt: skip
UNSEEN = tuple(sample for sample in HELD_OUT if sample.case in _LEFT_OUT)
SETS = {
    "development": DEVELOPMENT, "further": FURTHER, "held-out": HELD_OUT, "other": OTHERS,
    "noisy": NOISY, "unseen": UNSEEN,
}  # fmt: skip


def chosen_samples(sets: Sequence[str], cases: Sequence[str] | None) -> list[SampleSpec]:
    """The samples of some sets; of the cases `CASE` or `CASE-SEED` only, where there are any.

    Raises:
        InputError: a case that no sample of these sets has.
    """
    samples = [sample for name in sets for sample in SETS[name]]
    if cases is None:
        return samples
    names = {sample: {sample.case, f"{sample.case}-{sample.seed}"} for sample in samples}
    if unknown := set(cases) - set().union(*names.values()):
        raise InputError(f"no sample {', '.join(sorted(unknown))} in {', '.join(sets)}")
    return [sample for sample in samples if names[sample] & set(cases)]
