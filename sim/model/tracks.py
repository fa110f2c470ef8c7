"""States of a model over time, and what moves with them: its bodies and the rig that it carries.

Between two states joints move at constant velocity, hinges and slides along a line and ball and
free joints along a great circle: `mj_integratePos`, which is what MuJoCo's integrators do with the
velocity of a step.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.mjcf import model_of
from eventsweep.sim.model.mounts import Mount
from eventsweep.sim.motion import Animation

Array = NDArray[np.float64]
# Of a microsecond.
_DIGITS = 3


@dataclass(frozen=True, eq=False)
class StateTrack:
    """Joint positions and mocap poses at rising times; an `sim.motion.Animation`.

    Attributes:
        t_us: (T,) int64, from 0, µs.
        qpos: (T, nq).
        mocap: (T, nmocap, 7) position and quaternion w, x, y, z.
        max_interval_us: longest time between two frames half a pixel apart, see `Animation`.
    """

    t_us: NDArray[np.int64]
    qpos: Array
    mocap: Array
    max_interval_us: int = 2_000

    @classmethod
    def at_rest(cls, data: Any) -> StateTrack:
        """The state of `data` for ever."""
        qpos, mocap = state_of(data)
        return cls(np.zeros(1, np.int64), qpos[None], mocap[None])

    def __call__(self, model: Any, data: Any, t_s: float) -> None:
        """Sets `data` to the state at `t_s`, s; before the first and after the last, those."""
        t_us = round(t_s * 1e6, _DIGITS)  # a time that is a state's own finds that state
        after = int(np.searchsorted(self.t_us, t_us, side="right"))
        before = min(max(after - 1, 0), len(self.t_us) - 1)
        data.qpos[:] = self.qpos[before]
        data.mocap_pos[:], data.mocap_quat[:] = _split(self.mocap[before])
        if 0 < after < len(self.t_us):
            start_us, end_us = self.t_us[after - 1 : after + 1].tolist()
            share = (t_us - start_us) / (end_us - start_us)
            if share > 0:
                self._advance(model, data, after, share)

    def _advance(self, model: Any, data: Any, after: int, share: float) -> None:
        mj = import_mujoco()
        velocity = np.empty(model.nv)
        mj.mj_differentiatePos(model, velocity, 1.0, self.qpos[after - 1], self.qpos[after])
        mj.mj_integratePos(model, data.qpos, velocity, share)
        if model.nmocap:
            place, turn = _split(self.mocap[after])
            data.mocap_pos += share * (place - data.mocap_pos)
            for k in range(model.nmocap):
                velocity = np.empty(3)
                mj.mju_subQuat(velocity, turn[k], data.mocap_quat[k])
                mj.mju_quatIntegrate(data.mocap_quat[k], velocity, share)


def _split(mocap: Array) -> tuple[Array, Array]:
    return mocap[:, :3], mocap[:, 3:]


def state_of(data: Any) -> tuple[Array, Array]:
    """Joint positions (nq,) and mocap poses (nmocap, 7), copied."""
    return data.qpos.copy(), np.hstack([data.mocap_pos, data.mocap_quat])


@dataclass(eq=False)
class CarriedMotion:
    """The motion of a rig that a model carries; a `sim.motion.Motion`.

    Attributes:
        path: the model's file; read again in every process.
        track: the model's states.
        mount: what carries the rig.
        T_mount_body: (4, 4) the rig's body on it.
    """

    path: Path
    track: StateTrack
    mount: Mount
    T_mount_body: Array = field(default_factory=lambda: np.eye(4))

    def T_world_body(self, t_s: float) -> Array:
        """Pose (4, 4) at `t_s`, s."""
        model, data = self._world()
        return carried(model, data, self.track, self.mount, t_s) @ self.T_mount_body

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_made"}

    def _world(self) -> tuple[Any, Any]:
        made: tuple[Any, Any] | None = self.__dict__.get("_made")
        if made is None:
            model = model_of(self.path)
            made = self.__dict__["_made"] = model, import_mujoco().MjData(model)
        return made


class LiveTrack:
    """The states of the last two steps of a simulation that goes on; an `Animation`."""

    max_interval_us = StateTrack.max_interval_us

    def __init__(self) -> None:
        self._track: StateTrack | None = None

    @property
    def now_us(self) -> int:
        """Time of the last state, µs from the first."""
        return 0 if self._track is None else int(self._track.t_us[-1])

    def begin(self, data: Any) -> None:
        """Takes the first state."""
        self._track = StateTrack.at_rest(data)

    def push(self, t_us: int, data: Any) -> int:
        """Adds a state; returns the time of the one before, µs."""
        assert self._track is not None
        before_us, (qpos, mocap) = self.now_us, state_of(data)
        self._track = StateTrack(
            np.array([before_us, t_us]),
            np.stack([self._track.qpos[-1], qpos]),
            np.stack([self._track.mocap[-1], mocap]),
        )
        return before_us

    def __call__(self, model: Any, data: Any, t_s: float) -> None:
        """Sets `data` to the state at `t_s`, s, between the last two."""
        assert self._track is not None
        self._track(model, data, t_s)


class LiveMotion:
    """The motion of a rig on a model between its last two steps; a `sim.motion.Motion`.

    Args:
        model: that somebody steps.
        track: its last states.
        mount: what carries the rig.
        T_mount_body: (4, 4) the rig's body on it.
    """

    def __init__(self, model: Any, track: LiveTrack, mount: Mount, T_mount_body: Array) -> None:
        self._model, self._data = model, import_mujoco().MjData(model)
        self._track, self._mount, self._T_mount_body = track, mount, T_mount_body

    def T_world_body(self, t_s: float) -> Array:
        """Pose (4, 4) at `t_s`, s."""
        T_world_mount = carried(self._model, self._data, self._track, self._mount, t_s)
        return np.asarray(T_world_mount @ self._T_mount_body)


def carried(model: Any, data: Any, track: Animation, mount: Mount, t_s: float) -> Array:
    """`T_world_body` (4, 4) of what a mount carries at `t_s`; leaves `data` there."""
    mj = import_mujoco()
    track(model, data, t_s)
    mj.mj_kinematics(model, data)
    if mount.kind == "camera":
        mj.mj_comPos(model, data)
        mj.mj_camlight(model, data)
    return mount.T_world_body(data)
