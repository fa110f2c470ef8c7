"""Twin of DSEC: a car drives down a street between parked cars and houses."""

from __future__ import annotations

from pathlib import Path

from eventsweep.scenes.parts.drive import CAR
from eventsweep.scenes.parts.street import edit, textures
from eventsweep.sim.motion.curves import HeadSway
from eventsweep.sim.scene import Scene


def _motion(_duration_s: float, seed: int) -> HeadSway:
    return CAR.motion((-0.3, 0.0, 2.0), (-0.3, 20.0, 1.95), seed)


SCENE = Scene(
    name="dsec-street",
    summary="a car drives down a street of parked cars and houses, 4 to 50 m",
    mjcf=Path(__file__).with_name("street.xml"),
    textures=textures,
    motion=_motion,
    depth_range_m=(4.0, 50.0),
    rig="dsec",
    edit=edit,
)
