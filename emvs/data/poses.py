"""Trajectories as text: TUM's columns, with times of any unit; KITTI's rows are written only."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.stamps import text_of
from eventsweep.emvs.errors import InputError, located, said
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.files import atomic_path

POSES_FILE = "poses.txt"
"""Of a sequence."""
PER_UNIT_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
_LARGEST_US = 2.0**62
_US_EPOCHS = 1e17  # more microseconds since 1970 than anybody's clock counts
_NO_NUMBERS = ("nan", "NaN", "inf")  # a time that is none, but no header either
_COLUMNS = "t x y z qx qy qz qw"


def read_poses(path: str | Path, unit: str = "s", shift_us: int = 0) -> Trajectory:
    """Reads lines `t x y z qx qy qz qw`, separated by blanks or commas.

    Args:
        path: the text; `#` starts a comment, and a first line without numbers is a header.
        unit: what `t` counts: `s`, `ms`, `us` or `ns`.
        shift_us: added to every time, µs.

    Raises:
        InputError: an unreadable file, a line that is no pose, or impossible poses.
    """
    path = Path(path)
    if unit not in PER_UNIT_US:
        raise InputError(f"{path}: time unit {unit!r}; choose {', '.join(PER_UNIT_US)}")
    rows = _rows(path)
    t_us = np.round(rows[:, 0] * PER_UNIT_US[unit]) + shift_us
    bad = np.flatnonzero(~(np.abs(t_us) < _LARGEST_US))
    if bad.size:
        time = float(rows[bad[0], 0])
        finer = "ns" if time > _US_EPOCHS else "us"
        cure = f": set unit to {finer!r}" if unit == "s" and 0 < time < math.inf else ""
        raise InputError(
            f"{path}: pose {bad[0]} at {time:g} {unit}; needs a finite time, < 2^62 µs{cure}"
        )
    with located(path):
        return Trajectory(t_us.astype(np.int64), rows[:, 1:4].copy(), rows[:, 4:8].copy())


def write_kitti(path: Path, trajectory: Trajectory) -> None:
    """Writes KITTI's form: the first three rows of each `T_world_body`; times are lost."""
    T_world_body = trajectory.at(trajectory.t_us)
    with atomic_path(Path(path)) as partial:
        np.savetxt(partial, T_world_body[:, :3].reshape(-1, 12), fmt="%.12e")


def _rows(path: Path) -> NDArray[np.float64]:
    rows, text = [], text_of(path, "ascii", f"lines `{_COLUMNS}`")
    for number, line in enumerate(text.replace(",", " ").splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        is_header = number == 1 and words and words[0][0].isalpha() and words[0] not in _NO_NUMBERS
        if words and not is_header:
            rows.append(_row(f"{path}, line {number}", words))
    if not rows:
        raise InputError(f"{path}: no poses; expected lines `{_COLUMNS}`")
    return np.array(rows, np.float64)


def _row(where: str, words: list[str]) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise InputError(f"{where}: {said(error)}; needs numbers `{_COLUMNS}`") from error
    if len(values) != 8:
        raise InputError(f"{where}: {len(values)} numbers; expected `{_COLUMNS}`")
    return values


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
