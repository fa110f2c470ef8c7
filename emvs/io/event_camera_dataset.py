"""Reads the Event Camera Dataset (Mueggler et al., IJRR 2017) as its publisher lays it out.

A folder with `events.txt` (t_s x y p), `calib.txt` (fx fy cx cy k1 k2 p1 p2 k3) and
`groundtruth.txt` (t_s x y z qx qy qz qw of T_world_cam); optionally frames, listed in `images.txt`.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emvs.data.camera import Camera
from emvs.data.events import Events
from emvs.data.rig import Rig
from emvs.data.trajectory import Trajectory
from emvs.data.tum import read_tum
from emvs.errors import InputError
from emvs.io.event_text import EventText
from emvs.io.events.wording import said
from emvs.io.png import read_grey

FILES = ("events.txt", "calib.txt", "groundtruth.txt")
# Every sequence of the data set comes from a DAVIS240C; frames, where there are any, say it again.
_SENSOR_PX = (240, 180)


class EventCameraDataset:
    """One sequence of the data set: a `Recording` of a single camera."""

    depth_range_m = None

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self.name = self.path.resolve().name
        camera = _read_calibration(self.path / "calib.txt", _sensor_size(self.path))
        self.rig = Rig("DAVIS240C", (camera,), (np.eye(4),))
        self.trajectory: Trajectory = read_tum(self.path / "groundtruth.txt")

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """Times of the first and the last event, µs."""
        return self._events(camera).span_us

    def event_count(self, camera: int) -> int:
        """Events of the camera."""
        return self._events(camera).count

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`."""
        return self._events(camera).read(t0_us, t1_us)

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """(H, W) the frame of `images.txt` nearest to a time; None where there are no frames."""
        del camera
        if not self._frames:
            return None
        name = min(self._frames, key=lambda entry: abs(entry[0] - t_us))[1]
        return read_grey(self.path / name)

    def _events(self, camera: int) -> EventText:
        if camera != 0:
            raise InputError(f"{self.path}: camera {camera} asked for, there is one, camera 0")
        return self._text

    @cached_property
    def _frames(self) -> list[tuple[int, str]]:
        """Time in µs and file name of each frame."""
        path = self.path / "images.txt"
        if not path.exists():
            return []
        try:
            words = [line.split() for line in path.read_text(encoding="ascii").splitlines()]
            frames = [(round(float(t_s) * 1e6), name) for t_s, name in filter(None, words)]
        except (OSError, ValueError, OverflowError) as error:
            raise InputError(f"{path}: needs lines `t_s file` ({said(error)})") from error
        for _, name in frames:
            if not name.isprintable() or name.startswith("/") or ".." in name:
                raise InputError(f"{path}: {name[:60]!a} is no file of this folder; correct it")
        return frames

    @cached_property
    def _text(self) -> EventText:
        sensor = self.rig.cameras[0]
        return EventText(self.path / "events.txt", sensor.width_px, sensor.height_px)


def _sensor_size(folder: Path) -> tuple[int, int]:
    """Width and height of the frames, or of the data set's sensor where there are none."""
    frame = next(iter(sorted((folder / "images").glob("*.png"))), None)
    if frame is None:
        return _SENSOR_PX
    height_px, width_px = read_grey(frame).shape
    return width_px, height_px


def _read_calibration(path: Path, size_px: tuple[int, int]) -> Camera:
    try:
        values = [float(word) for word in path.read_text(encoding="ascii").split()]
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a calibration ({said(error)})") from error
    if len(values) != 9:
        raise InputError(f"{path}: {len(values)} numbers; needs fx fy cx cy k1 k2 p1 p2 k3")
    try:
        fx, fy, cx, cy, *terms = values
        return Camera(*size_px, fx, fy, cx, cy, "radtan", tuple(terms))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
