"""High dynamic range by night: a desk lamp in a dark room."""

from __future__ import annotations

from eventsweep.scenes.parts.den import case, night
from eventsweep.scenes.parts.heads import centred
from eventsweep.sim.motion.head_motion import six_dof

SCENE = case(
    "hdr-night",
    "a desk lamp in a dark room, 1000 to 1, 0.6 to 12 m",
    centred(six_dof, (-0.2, 0.0, 1.2), (-0.3, 3.0, 1.12)),
    night,
)
