"""Twin of TUM-VIE mocap-6dof: free motion before a table in a motion-capture room."""

from __future__ import annotations

from eventsweep.scenes.parts.heads import Centred, centred
from eventsweep.scenes.parts.mocap import case
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import six_dof


def _motion(duration_s: float, seed: int) -> Centred:
    rest = look_at((0, 0.08, 1.22), (0.05, 2.0, 0.88))
    return centred(six_dof(duration_s, seed), duration_s, rest)


SCENE = case("tumvie-6dof", "a motion-capture room, six-DoF head motion, 0.45 to 4 m", _motion)
