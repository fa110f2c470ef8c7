"""Twin of TUM-VIE skate-easy: a skater glides down a long corridor."""

from __future__ import annotations

from pathlib import Path

from eventsweep.scenes.parts.corridor import edit, textures
from eventsweep.sim.motion import Motion, head_motion
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.scene import Scene


def _motion(duration_s: float, seed: int) -> Motion:
    return head_motion.placed(
        head_motion.skate(duration_s, seed), look_at((0.0, 0.0, 1.72), (0.0, 10.0, 1.5))
    )


SCENE = Scene(
    name="tumvie-skate",
    summary="a skater glides down a long corridor, forward, 1 to 20 m",
    mjcf=Path(__file__).with_name("corridor.xml"),
    textures=textures,
    motion=_motion,
    depth_range_m=(1.0, 20.0),
    rig="tumvie-kb4",
    edit=edit,
)
