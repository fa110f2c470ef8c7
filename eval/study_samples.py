"""The simulated samples of the extraction study: those that chose, and those kept apart."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wanted:
    """One sample to simulate.

    Attributes:
        case: scene.
        rig: name of the rig.
        seconds: length, s.
        seed: seed of the head motion.
    """

    case: str
    rig: str = "davis346"
    seconds: float = 0.5
    seed: int = 0


_FIRST = ("planes", "desk", "boxes")
_TWINS = (
    Wanted("rpg-boxes", "rpg"),
    Wanted("rpg-reader", "rpg"),
    Wanted("rpg-monitor", "rpg"),
    Wanted("rpg-bin", "rpg"),
    Wanted("mvsec-flying", "mvsec"),
    Wanted("tumvie-6dof"),
    Wanted("tumvie-desk2"),
    Wanted("tumvie-1d"),
    Wanted("tumvie-3d"),
    Wanted("hdr-window"),
    Wanted("hdr-night"),
    Wanted("moving-objects"),
    Wanted("low-texture"),
    Wanted("repetitive"),
    Wanted("thin-structures"),
    Wanted("reflective"),
    Wanted("trinocular-desk", "trinocular"),
)

# Chose the parameters and the reliability: one motion through every scene
DEVELOPMENT = (*(Wanted(case) for case in _FIRST), *_TWINS)
# Looked at once, by the command that writes the tables: other motions through the scenes
HELD_OUT = (
    *(Wanted(case, seed=seed) for case in _FIRST for seed in (2, 3)),
    *(Wanted(w.case, w.rig, w.seconds, 1) for w in _TWINS),
)
# Other scenes, and sensors of 640x480 and 1280x720: nothing was chosen on them
OTHERS = (
    Wanted("tumvie-run"),
    Wanted("tumvie-skate"),
    Wanted("tumvie-bike"),
    Wanted("dsec-street", "dsec", 0.2),
    Wanted("tumvie-3d", "tumvie-kb4", 0.2),
)
SETS = {"development": DEVELOPMENT, "held-out": HELD_OUT, "other": OTHERS}
