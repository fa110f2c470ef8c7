"""Twin of TUM-VIE mocap-desk2: somebody looks around two desks in a motion-capture room."""

from __future__ import annotations

from eventsweep.scenes.parts.heads import Centred, centred
from eventsweep.scenes.parts.mocap import case
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import six_dof


def _motion(duration_s: float, seed: int) -> Centred:
    rest = look_at((0.82, 0.72, 1.2), (1.62, 2.2, 0.96))
    return centred(six_dof(duration_s, seed), duration_s, rest)


SCENE = case("tumvie-desk2", "desks with monitors in a motion-capture room, 0.45 to 4 m", _motion)
