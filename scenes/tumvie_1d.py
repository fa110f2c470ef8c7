"""Twin of TUM-VIE mocap-1d-trans: sideways translation and nothing else."""

from __future__ import annotations

from eventsweep.scenes.parts.heads import Centred, centred
from eventsweep.scenes.parts.mocap import case
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import translate_1d


def _motion(duration_s: float, seed: int) -> Centred:
    rest = look_at((0.1, 0.14, 1.22), (-0.15, 2.2, 0.92))
    return centred(translate_1d(duration_s, seed), duration_s, rest)


SCENE = case("tumvie-1d", "a motion-capture room, translation along one axis, 0.45 to 4 m", _motion)
