"""A generated head motion brought to where a case wants it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.sim.motion import Motion
from eventsweep.sim.motion.curves import Vector3, look_at
from eventsweep.sim.motion.head_motion import generate


@dataclass(frozen=True)
class Centred:
    """A motion whose pose in the middle of its time is where a case wants it.

    A head's drift takes it 20 cm and more from where it started; what a case promises about depth
    holds around the place that it is centred on.
    """

    motion: Motion
    T_world_start: NDArray[np.float64]

    def T_world_body(self, t_s: float) -> NDArray[np.float64]:
        """Pose (4, 4) at `t_s`."""
        return np.asarray(self.T_world_start @ self.motion.T_world_body(t_s), np.float64)


def centred(style: str, eye_m: Vector3, target_m: Vector3, duration_s: float, seed: int) -> Centred:
    """A head of a style, moved so that half-way it is at `eye_m` and looks at `target_m`, m."""
    motion = generate(style, duration_s, seed)
    middle = motion.T_world_body(duration_s / 2)
    return Centred(motion, look_at(eye_m, target_m) @ np.linalg.inv(middle))
