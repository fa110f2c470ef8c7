"""Trajectories as text: columns of TUM, EuRoC or ROS, named or not, and KITTI's rows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.headers import (
    PER_UNIT_US,
    agreed_unit,
    fields_of,
    finer_unit,
    header_of,
    impossible,
    is_names,
    unit_of,
)
from eventsweep.emvs.data.stamps import read_stamps, text_of
from eventsweep.emvs.errors import InputError, located, said
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.files import atomic_path

POSES_FILE = "poses.txt"
"""Of a sequence."""
_KITTI_TIMES = "times.txt"
_LARGEST_US = 2.0**62
_SLOW_S, _SLOW_PAIR_S = 60.0, 86_400.0  # from pose to pose: no trajectory, even of two poses
_ROLES = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
_COLUMNS = " ".join(_ROLES)
_KITTI = 12
_WITH_VELOCITY = len(_ROLES) + 3  # EvSLAM's


class _Table(NamedTuple):
    """Rows in the order of `_ROLES`, or of KITTI's twelve numbers; the unit that a header says."""

    rows: NDArray[np.float64]
    said: str


def read_poses(path: str | Path, unit: str | None = None, shift_us: int = 0) -> Trajectory:
    """Reads lines `t x y z qx qy qz qw`, or the columns that a header names, in any order.

    KITTI's rows of twelve numbers take their times from a file `times.txt` beside them; of eleven
    numbers without header the last three, EvSLAM's velocity, are left out.

    Args:
        path: the text; blanks, commas or semicolons part columns, `#` or `%` starts a comment.
        unit: what `t` counts: `s`, `ms`, `us` or `ns`; empty: what the header says, else s. None
            where the caller has no such setting.
        shift_us: added to every time, µs.

    Returns:
        The poses; of poses at one and the same time the first, and a note says so.

    Raises:
        InputError: an unreadable file, a line that is no pose, a header that contradicts `unit` or
            is not understood, times that cannot be, or impossible poses.
    """
    path = Path(path)
    if unit and unit not in PER_UNIT_US:
        raise InputError(f"{path}: time unit {unit!r}; choose {', '.join(PER_UNIT_US)}")
    table = _table(path)
    if table.rows.shape[1] == _KITTI:
        return _of_kitti(path, table.rows, unit, shift_us)
    counted = agreed_unit(str(path), table.said, unit or "")
    t_us = _times_us(path, table.rows[:, 0], counted, asks=unit is not None) + shift_us
    with located(path):
        return _first_of_each(table.rows, t_us)


def _first_of_each(rows: NDArray[np.float64], t_us: NDArray[np.int64]) -> Trajectory:
    """The poses without those whose time is that of the pose before."""
    kept = np.append(True, np.diff(rows[:, 0]) != 0)
    if kept.sum() == 1:  # nothing but one time: refused as such
        kept[:] = True
    repeats = len(kept) - int(kept.sum())
    note = f"{repeats} of {len(kept)} poses repeat the time before them: the first of each is kept"
    quats, places = rows[kept, 4:8], rows[kept, 1:4]
    return Trajectory(t_us[kept], places, quats, notes=(note,) if repeats else ())


@np.errstate(over="ignore", invalid="ignore")  # what is too large is refused below
def _times_us(path: Path, t: NDArray[np.float64], counted: str, *, asks: bool) -> NDArray[np.int64]:
    """Times in whole µs; those that cannot be are refused where nothing says their unit."""
    t_us = np.round(t * PER_UNIT_US[counted or "s"])
    bad = np.flatnonzero(~(np.abs(t_us) < _LARGEST_US))
    why = "" if not bad.size else f"pose {bad[0]} at {t[bad[0]]:g} {counted or 's'}"
    if not why and not counted:
        why = _doubt(t_us)
    if not why:
        return t_us.astype(np.int64)
    step = float(np.median(np.abs(np.diff(t)))) if len(t) > 1 else 0.0
    finer = finer_unit(float(t[bad[0] if bad.size else 0]), counted or "s", step)
    cures = [f"set unit to {finer!r}"] if asks else []
    cures += [f"name time in a header, as `# t_{finer} {_COLUMNS[2:]}`"] if not counted else []
    cure = f": if it counts {finer}, {', or '.join(cures)}" if finer and cures else ""
    raise InputError(f"{path}: {why}; needs a finite time, < 2^62 µs{cure}")


def _doubt(t_us: NDArray[np.float64]) -> str:
    """Why times that would be s, here in µs, cannot be; empty where they can."""
    year = impossible(int(t_us[0])) or impossible(int(t_us[-1]))
    if year:
        return f"times in s would reach {year}"
    step_s = float(np.median(np.abs(np.diff(t_us)))) * 1e-6 if len(t_us) > 1 else 0.0
    slow = step_s > (_SLOW_S if len(t_us) > 2 else _SLOW_PAIR_S)
    return f"times in s would be {step_s:g} s apart" if slow else ""


def _of_kitti(path: Path, rows: NDArray[np.float64], unit: str | None, shift_us: int) -> Trajectory:
    """Poses from the first three rows of each `T_world_body`, with times from beside them."""
    times = path.parent / _KITTI_TIMES
    if not times.is_file():
        raise InputError(
            f"{path}: {_KITTI} numbers per line are KITTI's poses, without times; put a file "
            f"{_KITTI_TIMES} with a line t_s per pose beside it"
        )
    t_us = np.array(read_stamps(times, unit or None).t_us, np.int64) + shift_us
    if len(t_us) != len(rows):
        raise InputError(f"{times}: {len(t_us)} times for {len(rows)} poses of {path}")
    T_world_body = np.tile(np.eye(4), (len(rows), 1, 1))
    T_world_body[:, :3] = rows.reshape(-1, 3, 4)
    bad = next((k for k, T in enumerate(T_world_body) if not se3.is_rigid(T, 1e-3)), None)
    if bad is not None:
        raise InputError(f"{path}: pose {bad} is no rotation and position in rows of four numbers")
    with located(path):
        return Trajectory.from_matrices(t_us, T_world_body)


def write_kitti(path: Path, trajectory: Trajectory) -> None:
    """Writes KITTI's form: the first three rows of each `T_world_body`; times are lost."""
    T_world_body = trajectory.at(trajectory.t_us)
    with atomic_path(Path(path)) as partial:
        np.savetxt(partial, T_world_body[:, :3].reshape(-1, 12), fmt="%.12e")


def _table(path: Path) -> _Table:
    """The rows of a text, and what its header says."""
    head: list[str] = []
    lines: list[tuple[int, str]] = []
    for number, line in enumerate(text_of(path, f"lines `{_COLUMNS}`").splitlines(), start=1):
        is_title = is_names(line) and not lines and not any(map(is_names, head))
        if line.lstrip().startswith(("#", "%")) or is_title:
            head += [] if lines else [line]
        elif text := line.split("#", 1)[0].strip():
            lines.append((number, text))
    if not lines:
        raise InputError(f"{path}: no poses; expected lines `{_COLUMNS}`")
    columns = header_of(str(path), head, lines[0][1], _ROLES)
    if columns is None:
        count = len(fields_of(lines[0][1]))
        count = count if count in (_KITTI, _WITH_VELOCITY) else len(_ROLES)
        kept = _KITTI if count == _KITTI else len(_ROLES)
        return _Table(_rows(path, lines, range(kept), count), "")
    roles = [column.role for column in columns]
    pair = "secs" in roles
    places = [roles.index("secs" if role == "t" and pair else role) for role in _ROLES]
    places += [roles.index("nsecs")] if pair else []
    rows = _rows(path, lines, places, len(columns))
    if pair:
        rows = np.column_stack([rows[:, 0] + 1e-9 * rows[:, 8], rows[:, 1:8]])
    return _Table(rows, unit_of(columns, fields_of(lines[0][1])[places[0]]))


def _rows(
    path: Path, lines: Sequence[tuple[int, str]], places: Sequence[int], count: int
) -> NDArray[np.float64]:
    """The numbers in places of lines, each of which must have `count` fields."""
    rows = []
    for number, line in lines:
        words = fields_of(line)
        if len(words) != count:
            needs = f"`{_COLUMNS}`" if count == len(_ROLES) else f"{count}, as above"
            raise InputError(f"{path}, line {number}: {len(words)} numbers; expected {needs}")
        try:
            rows.append([float(words[k]) for k in places])
        except ValueError as error:
            where = f"{path}, line {number}"
            raise InputError(f"{where}: {said(error)}; needs numbers `{_COLUMNS}`") from error
    return np.array(rows, np.float64)


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Writes TUM format: times to the microsecond, everything else to 9 decimals."""
    with atomic_path(Path(path)) as partial, partial.open("w", encoding="ascii") as file:
        file.write("# t_s x_m y_m z_m qx qy qz qw (T_world_body)\n")
        for t_us, position_m, quat in zip(
            trajectory.t_us, trajectory.positions_m, trajectory.quats_xyzw, strict=True
        ):
            sign = "-" if t_us < 0 else ""
            seconds, micros = divmod(abs(int(t_us)), 1_000_000)
            numbers = " ".join(f"{value:.12f}" for value in (*position_m, *quat))
            file.write(f"{sign}{seconds}.{micros:06d} {numbers}\n")
