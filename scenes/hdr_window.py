"""High dynamic range by day: a dark room and a sunlit garden in one view."""

from __future__ import annotations

from eventsweep.scenes.parts.den import case, day
from eventsweep.scenes.parts.heads import Centred, centred
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import six_dof


def _motion(duration_s: float, seed: int) -> Centred:
    rest = look_at((0.1, 0.0, 1.2), (0.15, 3.0, 1.32))
    return centred(six_dof(duration_s, seed), duration_s, rest)


SCENE = case(
    "hdr-window", "a dark room before a sunlit window, 1000 to 1, 0.6 to 12 m", _motion, day
)
