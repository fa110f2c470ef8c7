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
_TWINS = (
    SampleSpec("rpg-boxes", "rpg"),
    SampleSpec("rpg-reader", "rpg"),
    SampleSpec("rpg-monitor", "rpg"),
    SampleSpec("rpg-bin", "rpg"),
    SampleSpec("mvsec-flying", "mvsec"),
    SampleSpec("tumvie-6dof"),
    SampleSpec("tumvie-desk2"),
    SampleSpec("tumvie-1d"),
    SampleSpec("tumvie-3d"),
    SampleSpec("hdr-window"),
    SampleSpec("hdr-night"),
    SampleSpec("moving-objects"),
    SampleSpec("low-texture"),
    SampleSpec("repetitive"),
    SampleSpec("thin-structures"),
    SampleSpec("reflective"),
    SampleSpec("trinocular-desk", "trinocular"),
)

# Chose the parameters and the reliability: one motion through every scene
DEVELOPMENT = (*(SampleSpec(case) for case in _FIRST), *_TWINS)
# Took part in choosing too: other motions, of going forward as well
FURTHER = (
    *(SampleSpec(case, seed=1) for case in (*_FIRST, "tumvie-run", "tumvie-skate")),
    *(
        SampleSpec(case, seed=2)
        for case in ("low-texture", "thin-structures", "tumvie-1d", "tumvie-3d", "hdr-window")
    ),
    *(
        SampleSpec(case, seed=5)
        for case in (*_FIRST, "low-texture", "moving-objects", "repetitive")
    ),
    *(SampleSpec(w.case, w.rig, w.seconds, 5) for w in _TWINS[:9]),
)
# Looked at once, by the command that writes the tables: other motions through the scenes
HELD_OUT = (
    *(SampleSpec(case, seed=seed) for case in _FIRST for seed in (2, 3)),
    *(SampleSpec(w.case, w.rig, w.seconds, 1) for w in _TWINS),
)
# Going forward, a street, and sensors of 640x480 and 1280x720: nothing was chosen on these
OTHERS = (
    SampleSpec("tumvie-run"),
    SampleSpec("tumvie-skate"),
    SampleSpec("tumvie-bike"),
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
UNSEEN = tuple(one for one in HELD_OUT if one.case in _LEFT_OUT)
SETS = {
    "development": DEVELOPMENT,
    "further": FURTHER,
    "held-out": HELD_OUT,
    "other": OTHERS,
    "noisy": NOISY,
    "unseen": UNSEEN,
}


def chosen_samples(sets: Sequence[str], cases: Sequence[str] | None) -> list[SampleSpec]:
    """The samples of some sets; of the cases `CASE` or `CASE-SEED` only, where there are any.

    Raises:
        InputError: a case that no sample of these sets has.
    """
    samples = [one for name in sets for one in SETS[name]]
    if cases is None:
        return samples
    names = {one: {one.case, f"{one.case}-{one.seed}"} for one in samples}
    if unknown := set(cases) - set().union(*names.values()):
        raise InputError(f"no sample {', '.join(sorted(unknown))} in {', '.join(sets)}")
    return [one for one in samples if names[one] & set(cases)]
