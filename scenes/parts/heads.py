"""A generated head motion brought to where a case wants it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from eventsweep.sim.motion import Motion
from eventsweep.sim.motion.curves import HeadSway, Vector3, look_at

Head = Callable[[float, int], Motion]
Pose = NDArray[np.float64]
Sway = tuple[Vector3, Vector3, Sequence[float]]


@dataclass(frozen=True)
class Centred:
    """A motion whose pose in the middle of its time is `T_world_middle`.

    A head's drift takes it 20 cm and more from where it started; what a case promises about depth
    holds around the place that it is centred on.
    """

    motion: Motion
    T_world_start: Pose

    def T_world_body(self, t_s: float) -> Pose:
        """Pose (4, 4) at `t_s`."""
        return np.asarray(self.T_world_start @ self.motion.T_world_body(t_s), np.float64)


def centred(head: Head, eye_m: Vector3, target_m: Vector3) -> Callable[[float, int], Centred]:
    """Moves all of a head's motion so that at half its time it looks from a place at another."""
    return partial(_centred, head, look_at(eye_m, target_m))


def _centred(head: Head, T_world_middle: Pose, duration_s: float, seed: int) -> Centred:
    made = head(duration_s, seed)
    return Centred(made, T_world_middle @ np.linalg.inv(made.T_world_body(duration_s / 2)))


def swaying(eye_m: Vector3, target_m: Vector3, *sway: *Sway) -> Callable[[float, int], HeadSway]:
    """A head that looks from a place at another and sways, as `HeadSway.seeded` says."""
    return partial(_swaying, look_at(eye_m, target_m), sway)


def _swaying(T_world_rest: Pose, sway: Sway, _duration_s: float, seed: int) -> HeadSway:
    return HeadSway.seeded(T_world_rest, *sway, seed)
