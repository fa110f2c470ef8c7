"""Bodies that move by themselves: what moves them, and which geoms of a scene they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import mujoco


class Animation(Protocol):
    """Moves a scene's bodies; a pure function of time, whatever was asked for before."""

    @property
    def max_interval_us(self) -> int:
        """Frames must never be further apart, µs, lest a body cross the view between two."""
        ...

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData, t_s: float) -> None:
        """Sets joint positions (and mocap poses) in `data` for `t_s`, s from the start."""
        ...


def moving_geoms(model: Any) -> NDArray[np.bool_]:
    """(G,) which geoms of a compiled model hang on a joint or on a mocap body."""
    driven = model.body_mocapid[model.body_rootid] >= 0
    moving: NDArray[np.bool_] = ((model.body_weldid != 0) | driven)[model.geom_bodyid]
    return moving
