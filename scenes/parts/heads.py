"""A generated head motion brought to where a case wants it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.sim.motion import Motion


@dataclass(frozen=True)
class Centred:
    """A motion whose pose in the middle of its time is `T_world_middle`.

    A head's drift takes it 20 cm and more from where it started; what a case promises about depth
    holds around the place that it is centred on.
    """

    motion: Motion
    T_world_start: NDArray[np.float64]

    def T_world_body(self, t_s: float) -> NDArray[np.float64]:
        """Pose (4, 4) at `t_s`."""
        return np.asarray(self.T_world_start @ self.motion.T_world_body(t_s), np.float64)


def centred(motion: Motion, duration_s: float, T_world_middle: NDArray[np.float64]) -> Centred:
    """Moves all of `motion` so that it passes through `T_world_middle` (4, 4) at half its time."""
    middle = motion.T_world_body(duration_s / 2)
    return Centred(motion, T_world_middle @ np.linalg.inv(middle))
