"""What moves: the rig, by smooth curves, as heads do or as recorded; and bodies by themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import mujoco


class Motion(Protocol):
    """A smooth curve of the body's pose; the body's axes are camera 0's: right, down, forward."""

    def T_world_body(self, t_s: float) -> NDArray[np.float64]:
        """Pose (4, 4) at time `t_s`, seconds from the start of the sequence; world z is up."""
        ...


class Animation(Protocol):
    """Moves a scene's bodies; a pure function of time, whatever was asked for before."""

    @property
    def max_interval_us(self) -> int:
        """Frames must never be further apart, µs, lest a body cross the view between two."""
        ...

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData, t_s: float) -> None:
        """Sets joint positions (and mocap poses) in `data` for `t_s`, s from the start."""
        ...
