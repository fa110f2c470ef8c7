"""Trajectories as text: TUM's columns, with times of any unit, and KITTI's rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, said
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.inputs import TABLE_BYTES, read_text

POSES_FILE = "poses.txt"
"""Of a sequence."""
PER_UNIT_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
_LARGEST_US = 2.0**62


def read_poses(path: str | Path, unit: str = "s", shift_us: int = 0) -> Trajectory:
    """Reads lines `t x y z qx qy qz qw`, separated by blanks or commas.

    Args:
        path: the text; `#` starts a comment, and a first line without numbers is a header.
        unit: what `t` counts: `s`, `ms`, `us` or `ns`.
        shift_us: added to every time, µs.

    Returns:
        The poses as the file states them.

    Raises:
        InputError: an unreadable file, a line that is no pose, or impossible poses.
    """
    path = Path(path)
    if unit not in PER_UNIT_US:
        raise InputError(f"{path}: time unit {unit!r}; choose {', '.join(PER_UNIT_US)}")
    rows = _rows(path, 8, "t x y z qx qy qz qw")
    t_us = np.round(rows[:, 0] * PER_UNIT_US[unit]) + shift_us
    bad = np.flatnonzero(~(np.abs(t_us) < _LARGEST_US))
    if bad.size:
        raise InputError(
            f"{path}: pose {bad[0]} at {rows[bad[0], 0]:g} {unit}; needs a finite time"
        )
    try:
        return Trajectory(t_us.astype(np.int64), rows[:, 1:4].copy(), rows[:, 4:8].copy())
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def write_kitti(path: Path, trajectory: Trajectory) -> None:
    """Writes KITTI's form: the first three rows of each `T_world_body`; times are lost."""
    T_world_body = trajectory.at(trajectory.t_us)
    with atomic_path(Path(path)) as partial:
        np.savetxt(partial, T_world_body[:, :3].reshape(-1, 12), fmt="%.12e")


def read_kitti(path: Path, t_us: NDArray[np.int64]) -> Trajectory:
    """Reads KITTI's form, with times from elsewhere.

    Args:
        path: lines of twelve numbers.
        t_us: (N,) their times, µs.

    Raises:
        InputError: an unreadable file, a line that is no pose, or another number of times.
    """
    rows = _rows(path, 12, "the first three rows of T_world_body")
    if len(rows) != len(t_us):
        raise InputError(f"{path}: {len(rows)} poses for {len(t_us)} times; needs one per time")
    T_world_body = np.tile(np.eye(4), (len(rows), 1, 1))
    T_world_body[:, :3] = rows.reshape(-1, 3, 4)
    turned = T_world_body[:, :3, :3]
    error = np.abs(turned @ turned.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    if not np.isfinite(rows).all() or not (error < 1e-3).all():
        raise InputError(
            f"{path}: line {int(np.argmax(~(error < 1e-3))) + 1} is not a rigid motion"
        )
    return Trajectory.from_matrices(t_us, T_world_body)


def _rows(path: Path, columns: int, needs: str) -> NDArray[np.float64]:
    try:
        text = read_text(path, TABLE_BYTES, "ascii")
        lines = text.replace(",", " ").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not ASCII text"
        raise InputError(
            f"{path}: cannot be read ({reason}); needs a text file of poses"
        ) from error
    rows = []
    for number, line in enumerate(lines, start=1):
        words = line.split("#", 1)[0].split()
        if not words or (number == 1 and words[0][:1].isalpha()):
            continue
        rows.append(_row(f"{path}, line {number}", words, columns, needs))
    if not rows:
        raise InputError(f"{path}: no poses; needs lines of {columns} numbers: {needs}")
    return np.array(rows, np.float64)


def _row(where: str, words: list[str], columns: int, needs: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise InputError(f"{where}: {said(error)}; needs {columns} numbers: {needs}") from error
    if len(values) != columns:
        raise InputError(f"{where}: {len(values)} numbers; needs {columns}: {needs}")
    return values


def read_tum(path: Path) -> Trajectory:
    """Reads a TUM-format text: one `t_s x y z qx qy qz qw` per line, `#` starts a comment.

    Raises:
        InputError: a missing file, a line that is not eight numbers, or impossible poses.
    """
    rows = _read_rows(Path(path))
    t_us = np.round(rows[:, 0] * 1e6)
    known = np.abs(t_us) < _LARGEST_US
    if not known.all():
        raise InputError(f"{path}: pose {int(np.argmin(known))} has no finite time below 2^62 µs")
    try:
        return Trajectory(t_us.astype(np.int64), rows[:, 1:4].copy(), rows[:, 4:8].copy())
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


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


def _read_rows(path: Path) -> NDArray[np.float64]:
    try:
        text = read_text(path, TABLE_BYTES, "ascii")
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; needs poses in TUM format") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text ({error})") from error
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            rows.append(_tum_row(path, number, words))
    if not rows:
        raise InputError(f"{path}: no poses; needs lines `t_s x y z qx qy qz qw`")
    return np.array(rows, np.float64)


def _tum_row(path: Path, number: int, words: list[str]) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        words = [ascii(word)[:60] for word in words[:8]]
        raise InputError(
            f"{path}, line {number}: {' '.join(words)}; needs eight numbers"
        ) from error
    if len(values) != 8:
        raise InputError(
            f"{path}, line {number}: {len(values)} numbers; needs t_s x y z qx qy qz qw"
        )
    return values
