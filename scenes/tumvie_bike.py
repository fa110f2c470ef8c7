"""Twin of TUM-VIE bike-easy: a ride through a park between trees, fences and houses."""

from __future__ import annotations

from pathlib import Path

from eventsweep.scenes.parts.park import edit, textures
from eventsweep.sim.motion import Motion, head_motion
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.scene import Scene


def _motion(duration_s: float, seed: int) -> Motion:
    return head_motion.placed(
        head_motion.bike(duration_s, seed), look_at((0.3, 0.0, 1.85), (0.3, 20.0, 1.85))
    )


SCENE = Scene(
    name="tumvie-bike",
    summary="a ride through a park between trees, fences and houses, forward, 3 to 200 m",
    mjcf=Path(__file__).with_name("park.xml"),
    textures=textures,
    motion=_motion,
    depth_range_m=(3.0, 200.0),
    rig="tumvie-kb4",
    edit=edit,
)
