"""What moves a model: its own dynamics, with a controller or without, or recorded joints."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, heed_interrupt, offer
from eventsweep.emvs.utils.inputs import read_text
from eventsweep.emvs.utils.plugins import FUNCTION
from eventsweep.emvs.utils.plugins import named as named_function
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.mjcf import named
from eventsweep.sim.model.tracks import StateTrack, state_of

Controller = Callable[[Any, Any], object]
"""`control(model, data)`, called before each step: sets `data.ctrl`, forces or mocap poses."""
_TIME = "t_s"
_TABLE_BYTES = 1 << 30
_MOST_STATES = 10_000_000


def initial_data(model: Any, key: str) -> Any:
    """The model's first state: that of a key frame, or the one that its file describes.

    Raises:
        InputError: no key frame of that name.
    """
    mj = import_mujoco()
    data = mj.MjData(model)
    if key:
        keys = named(mj, model, "key")
        if key not in keys:
            there = offer(keys, "it has none, leave model.key out")
            raise InputError(f"no key frame {key!r} in the model: {there}")
        mj.mj_resetDataKeyframe(model, data, model.key(key).id)
    mj.mj_forward(model, data)
    return data


def run_dynamics(
    model: Any, duration_s: float, key: str = "", control: Controller | None = None
) -> StateTrack:
    """Lets MuJoCo step the model, and keeps every state.

    Raises:
        InputError: a model that has nothing to move, a time step below a microsecond, too many
            steps, a controller that fails, or a simulation that becomes unstable.
    """
    mj = import_mujoco()
    step_s, count = model.opt.timestep, int(np.ceil(duration_s / model.opt.timestep - 1e-9)) + 1
    if model.nq == 0 and model.nmocap == 0:
        raise InputError(
            "the model has no joints, so it has no motion of its own: choose another motion"
        )
    if step_s < 1e-6 or count > _MOST_STATES:
        raise InputError(
            f"{duration_s:g} s in steps of {step_s:g} s: needs steps of at least 1e-6 s, and at "
            f"most {_MOST_STATES:,} of them"
        )
    data, states, t_us = initial_data(model, key), [], []
    with _warnings_heard(mj):
        for _ in range(count):
            states.append(state_of(data))
            t_us.append(round(data.time * 1e6))
            _controlled(control, model, data)
            mj.mj_step(model, data)
            _check_stable(mj, data)
    qpos, mocap = (np.array(column) for column in zip(*states, strict=True))
    return StateTrack(np.array(t_us) - t_us[0], qpos, mocap)


def read_joints(path: Path, model: Any, key: str = "") -> StateTrack:
    """Reads positions of joints over time: CSV with a header `t_s` and names of joints.

    Columns hold rad or m of hinges and slides; joints that are not named keep their first state.

    Raises:
        InputError: an unreadable table, an unknown or unsuitable joint, or times that do not rise.
    """
    mj, start = import_mujoco(), initial_data(model, key)
    names, table = _table(path)
    if _TIME not in names or len(names) < 2 or len(set(names)) < len(names):
        raise InputError(
            f"{path}: columns {', '.join(names) or 'none'}: needs {_TIME} and one column per joint"
        )
    t_us = np.rint((table[:, names.index(_TIME)]) * 1e6).astype(np.int64)
    if len(t_us) < 2 or not (np.diff(t_us) > 0).all():
        raise InputError(f"{path}: {_TIME} must increase by 1 µs or more, over at least two rows")
    qpos, mocap = state_of(start)
    states = np.tile(qpos, (len(t_us), 1))
    for column, name in enumerate(names):
        if name != _TIME:
            states[:, _place_of(mj, model, name, path)] = table[:, column]
    return StateTrack(t_us - t_us[0], states, np.tile(mocap, (len(t_us), 1, 1)))


def load_controller(name: str) -> Controller:
    """The function that a name means, see `emvs.utils.plugins.named`.

    Raises:
        InputError: no such module, file or function, or one that fails.
    """
    try:
        control = named_function(name)
    except Exception as error:  # whatever a stranger's code raises
        heed_interrupt(error)
        raise InputError(f"controller {name!r}: {error}: give {FUNCTION}") from error
    if not callable(control):
        raise InputError(f"controller {name!r} is not a function: give {FUNCTION}")
    return cast(Controller, control)


@contextmanager
def _warnings_heard(mj: Any) -> Iterator[None]:
    """Keeps MuJoCo from writing its warnings to a file in the working directory: we tell them."""
    before = mj.get_mju_user_warning()
    mj.set_mju_user_warning(lambda _text: None)
    try:
        yield
    finally:
        mj.set_mju_user_warning(before)


def _controlled(control: Controller | None, model: Any, data: Any) -> None:
    if control is None:
        return
    try:
        control(model, data)
    except Exception as error:
        kind = type(error).__name__
        raise InputError(f"the controller failed at {data.time:g} s: {kind}: {error}") from error


def _check_stable(mj: Any, data: Any) -> None:
    for name in ("QPOS", "QVEL", "QACC"):
        if data.warning[getattr(mj.mjtWarning, f"mjWARN_BAD{name}")].number:
            raise InputError(
                f"the model becomes unstable at {data.time:g} s: lower its timestep or correct its "
                "contacts or controller"
            )


def _place_of(mj: Any, model: Any, name: str, path: Path) -> int:
    joints = named(mj, model, "joint")
    if name not in joints:
        raise InputError(
            f"{path}: no joint {name!r} in the model: it has {', '.join(joints) or 'none'}"
        )
    joint = model.joint(name)
    kinds = mj.mjtJoint
    if int(joint.type[0]) not in (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)):
        raise InputError(
            f"{path}: joint {name!r} is a free or ball joint: name hinge and slide joints only"
        )
    return int(joint.qposadr[0])


def _table(path: Path) -> tuple[list[str], NDArray[np.float64]]:
    rows = [row for row in csv.reader(io.StringIO(read_text(path, _TABLE_BYTES))) if row]
    names = [name.strip() for name in rows[0]] if rows else []
    try:
        table = np.array([_numbers(row, len(names)) for row in rows[1:]], np.float64)
    except ValueError as error:
        raise InputError(f"{path}: {error}: needs a header and rows of as many numbers") from error
    return names, table.reshape(len(table), len(names))


def _numbers(row: list[str], count: int) -> list[float]:
    values = [float(cell) for cell in row]
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"row {','.join(row)[:60]!r}")
    return values
