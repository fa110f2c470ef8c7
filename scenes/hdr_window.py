"""High dynamic range by day: a dark room and a sunlit garden in one view."""

from __future__ import annotations

from eventsweep.scenes.parts.den import case, day
from eventsweep.scenes.parts.heads import centred
from eventsweep.sim.motion.head_motion import six_dof

SCENE = case(
    "hdr-window",
    "a dark room before a sunlit window, 1000 to 1, 0.6 to 12 m",
    centred(six_dof, (0.1, 0.0, 1.2), (0.15, 3.0, 1.32)),
    day,
)
