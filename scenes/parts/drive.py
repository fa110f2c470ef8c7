"""Cars that drive straight on: a steady way, and what the road does to the body on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eventsweep.sim.motion.curves import HeadSway, Vector3, Wave, look_at


@dataclass(frozen=True)
class Drive:
    """How a vehicle goes.

    Attributes:
        speed_m_s: forward.
        bump_hz: bumps of the road per second.
        bob_m: amplitude up and down, once per bump.
        sway_m: amplitude sideways, once per two bumps.
        tilt_deg: pitch once per bump, yaw and roll once per two bumps.
        turn_deg: slow turns: pitch, yaw, roll.
        turn_s: their period.
    """

    speed_m_s: float
    bump_hz: float
    bob_m: float
    sway_m: float
    tilt_deg: Vector3
    turn_deg: Vector3
    turn_s: float = 2.6

    def motion(self, eye_m: Vector3, target_m: Vector3, seed: int) -> HeadSway:
        """The curve from `eye_m`, looking about `target_m`; the way is level, along the look."""
        rng = np.random.default_rng(seed)
        rest = look_at(eye_m, target_m)
        level = np.array([rest[0, 2], rest[1, 2], 0.0])
        way = rest[:3, :3].T @ (self.speed_m_s * level / np.linalg.norm(level))
        pitch, yaw, roll = self.tilt_deg
        bump, sway, slow = (tuple(rng.uniform(0, 2 * np.pi, 6).tolist()) for _ in range(3))
        waves = (
            Wave(1 / self.bump_hz, (0, self.bob_m, 0.3 * self.bob_m), (pitch, 0, 0), bump),
            Wave(2 / self.bump_hz, (self.sway_m, 0, 0), (0, yaw, roll), sway),
            Wave(self.turn_s, (0, 0, 0), self.turn_deg, slow),
        )
        return HeadSway(rest, waves, (float(way[0]), float(way[1]), float(way[2])))


CAR = Drive(9.0, 1.5, 0.006, 0.002, (0.15, 0.1, 0.15), (0.1, 0.6, 0.1), 5.0)
