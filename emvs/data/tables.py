"""Small tables beside a sequence: inertial samples, and what the ids of a segmentation mean."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from eventsweep.emvs.errors import InputError, refused
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.parameters import FrozenModel
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.inputs import TABLE_BYTES, read_text

Array = NDArray[np.float64]
IMU_FILE = "imu.csv"
_PLACE = "# T_body_imu x_m y_m z_m qx qy qz qw:"
_COLUMNS = "#t_us,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
GEOMS_FILE = "geoms.json"


@dataclass(frozen=True, eq=False)
class ImuSamples:
    """What an IMU reports, in its own axes.

    Attributes:
        t_us: (N,) int64, µs.
        gyro_rad_s: (N, 3) rotation rate.
        accel_m_s2: (N, 3) specific force: at rest it is 9.8 upwards.
        T_body_imu: (4, 4) where the IMU sits on the body.
    """

    t_us: NDArray[np.int64]
    gyro_rad_s: Array
    accel_m_s2: Array
    T_body_imu: Array = field(default_factory=lambda: np.eye(4))

    def __len__(self) -> int:
        return len(self.t_us)


def write_imu(path: str | Path, samples: ImuSamples) -> None:
    """Writes one row per sample: time in µs, gyroscope in rad/s, accelerometer in m/s^2."""
    position_m, quat_xyzw = se3.to_quat_xyzw(samples.T_body_imu)
    place = " ".join(f"{value:.12f}" for value in (*position_m, *quat_xyzw))
    with atomic_path(Path(path)) as partial, partial.open("w", encoding="ascii") as file:
        file.write(f"{_PLACE} {place}\n{_COLUMNS}\n")
        rows = np.hstack([samples.gyro_rad_s, samples.accel_m_s2]).tolist()
        for t_us, row in zip(samples.t_us.tolist(), rows, strict=True):
            file.write(f"{t_us}," + ",".join(f"{value:.9g}" for value in row) + "\n")


def read_imu(path: Path) -> ImuSamples:
    """Reads what `write_imu` wrote."""
    with refused(f"{path}: cannot be read as IMU samples", OSError, ValueError):
        text = read_text(path, TABLE_BYTES)
        T_body_imu = _place(text.partition("\n")[0])
        table = np.loadtxt(io.StringIO(text), delimiter=",", ndmin=2)
    if table.shape[1] != 7 or not np.isfinite(table).all():
        raise InputError(
            f"{path}: needs rows of seven finite numbers: t_us, gyro x y z, accel x y z"
        )
    if not (np.diff(table[:, 0]) > 0).all():
        raise InputError(f"{path}: times must increase from row to row")
    return ImuSamples(table[:, 0].astype(np.int64), table[:, 1:4], table[:, 4:], T_body_imu)


def _place(line: str) -> Array:
    if not line.startswith(_PLACE):
        raise ValueError(f"its first line must begin with {_PLACE!r}")
    numbers = np.array([float(word) for word in line.removeprefix(_PLACE).split()])
    if numbers.shape != (7,) or not np.isclose(np.linalg.norm(numbers[3:]), 1, atol=1e-6):
        raise ValueError("T_body_imu needs a position and a unit quaternion, seven numbers")
    return se3.from_quat_xyzw(numbers[:3], numbers[3:])


class Geom(FrozenModel):
    """One piece of a scene's geometry."""

    name: str
    """The scene's name for it, or that of its body, or its type; not always unique."""

    dynamic: bool
    """Whether it can move by itself; what is not dynamic moves only because the camera does."""


GeomTable = Mapping[int, Geom]
_TABLE = TypeAdapter(dict[int, Geom])


def write_geoms(folder: Path, geoms: GeomTable) -> None:
    """Writes `geoms.json` into a sequence's folder, by rising id."""
    text = _TABLE.dump_json(dict(sorted(geoms.items())), indent=1)
    (folder / GEOMS_FILE).write_bytes(text + b"\n")


def read_geoms(folder: Path) -> dict[int, Geom]:
    """Reads the table of a sequence."""
    path = folder / GEOMS_FILE
    try:
        return _TABLE.validate_json(read_text(path, TABLE_BYTES))
    except FileNotFoundError as error:
        raise InputError(f"{path}: not stored; simulate with `segmentation` in `truth`") from error
    except (OSError, UnicodeDecodeError, ValidationError) as error:
        raise InputError(f"{path}: damaged; create the sequence again") from error
