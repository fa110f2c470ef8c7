"""Twin of TUM-VIE mocap-3d-trans: translation along all three axes, no rotation."""

from __future__ import annotations

from eventsweep.scenes.parts.heads import Centred, centred
from eventsweep.scenes.parts.mocap import case
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import translate_3d


def _motion(duration_s: float, seed: int) -> Centred:
    rest = look_at((-0.1, 0.08, 1.24), (0.1, 2.2, 0.92))
    return centred(translate_3d(duration_s, seed), duration_s, rest)


SCENE = case(
    "tumvie-3d", "a motion-capture room, translation along three axes, 0.45 to 4 m", _motion
)
