"""Bodies that move by themselves: physics once, at a fixed step, then a pure function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.sim.graphics import import_mujoco

if TYPE_CHECKING:
    import mujoco

_STEP_S = 0.0005
_STEPS_PER_RECORD = 2
RECORD_S = _STEP_S * _STEPS_PER_RECORD
"""Positions are recorded this often, s, and interpolated between."""


@dataclass(frozen=True)
class Bodies:
    """Where the bodies of a scene are at any time, see `sim.motion.animation.Animation`.

    MuJoCo steps the scene's joints from their places in the MJCF with `start` velocities. The
    steps do not depend on when frames are taken, so any time can be asked for, in any order.

    Attributes:
        mjcf: the scene's file.
        build: adds the scene's geometry and joints, without shadows or pictures.
        start: velocity (linear m/s, then angular rad/s; one number for a hinge) by joint.
        max_interval_us: frames are never further apart, µs: what the bodies' speed demands.
    """

    mjcf: Path
    build: Callable[[mujoco.MjSpec], None]
    start: tuple[tuple[str, tuple[float, ...]], ...]
    max_interval_us: int

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData, t_s: float) -> None:
        """Sets the joint positions in `data` for time `t_s`, s from the start.

        Raises:
            InputError: a time before the start, or another scene's model.
        """
        if t_s < 0:
            raise InputError(f"bodies at {t_s} s: their motion starts at 0 s")
        recording = _recording(self)
        if model.nq != recording.model.nq:
            raise InputError(
                f"a model of {model.nq} joint positions, but the bodies of {self.mjcf.name} have "
                f"{recording.model.nq}: pass the model of the same scene"
            )
        data.qpos[:] = recording.positions(t_s)


class _Recording:
    """Joint positions every RECORD_S, made as far as they are asked for."""

    def __init__(self, bodies: Bodies) -> None:
        mj: Any = import_mujoco()
        spec = mj.MjSpec.from_file(str(bodies.mjcf))
        bodies.build(spec)
        spec.option.timestep = _STEP_S
        self._mj = mj
        self.model = spec.compile()
        self._data = mj.MjData(self.model)
        for joint, velocity in bodies.start:
            self._data.joint(joint).qvel[:] = velocity
        self._records: list[NDArray[np.float64]] = [self._data.qpos.copy()]

    def positions(self, t_s: float) -> NDArray[np.float64]:
        """Joint positions (nq,) at `t_s`, interpolated linearly, quaternions normalised."""
        before = int(t_s / RECORD_S)
        while len(self._records) < before + 2:
            self._mj.mj_step(self.model, self._data, _STEPS_PER_RECORD)
            self._records.append(self._data.qpos.copy())
        share = t_s / RECORD_S - before
        qpos = (1 - share) * self._records[before] + share * self._records[before + 1]
        self._mj.mj_normalizeQuat(self.model, qpos)
        return qpos


@cache
def _recording(bodies: Bodies) -> _Recording:
    return _Recording(bodies)


def make_solid(spec: mujoco.MjSpec) -> None:
    """Lets all geoms of a scene touch each other; rubber on wood, nearly elastic."""
    for geom in spec.geoms:
        geom.contype, geom.conaffinity, geom.condim = 1, 1, 6
        # Negative numbers are stiffness and damping per mass: a ball keeps most of its height.
        geom.solref = [-20000.0, -12.0]
        geom.friction = [0.7, 0.008, 0.002]
