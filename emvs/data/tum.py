"""Poses as text in TUM format: one `t_s x y z qx qy qz qw` per line, `#` starts a comment."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from emvs.geometry.trajectory import Trajectory
from emvs.utils.files import atomic_path

_LARGEST_US = 2.0**62


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


def write_tum(path: Path, trajectory: Trajectory) -> None:
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
        text = path.read_text(encoding="ascii")
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; needs poses in TUM format") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text ({error})") from error
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            rows.append(_row(path, number, words))
    if not rows:
        raise InputError(f"{path}: no poses; needs lines `t_s x y z qx qy qz qw`")
    return np.array(rows, np.float64)


def _row(path: Path, number: int, words: list[str]) -> list[float]:
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
