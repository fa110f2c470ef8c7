"""High dynamic range by night: a desk lamp in a dark room."""

from __future__ import annotations

from eventsweep.scenes.parts.den import case, night
from eventsweep.scenes.parts.heads import Centred, centred
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import six_dof


def _motion(duration_s: float, seed: int) -> Centred:
    rest = look_at((-0.2, 0.0, 1.2), (-0.3, 3.0, 1.12))
    return centred(six_dof(duration_s, seed), duration_s, rest)


SCENE = case("hdr-night", "a desk lamp in a dark room, 1000 to 1, 0.6 to 12 m", _motion, night)
