"""What moves the bodies of a scene that move by themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

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
