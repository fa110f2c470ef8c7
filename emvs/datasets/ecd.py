"""Reads the Event Camera Dataset (Mueggler et al., IJRR 2017) as its publisher lays it out.

A folder with `events.txt` (t_s x y p), `calib.txt` (fx fy cx cy k1 k2 p1 p2 k3) and
`groundtruth.txt` (t_s x y z qx qy qz qw of T_world_cam), which may be missing; optionally frames,
listed in `images.txt`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import Span
from eventsweep.emvs.data.recording import no_poses, summary
from eventsweep.emvs.datasets.posed import recorded_poses
from eventsweep.emvs.errors import InputError, located, refused
from eventsweep.emvs.formats.depth import read_grey
from eventsweep.emvs.formats.prophesee import STREAM
from eventsweep.emvs.formats.tables.text import TextLayout, TextReader
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.inputs import SETTINGS_BYTES, TABLE_BYTES, read_text

FILES = ("events.txt", "calib.txt")
_POSES = "groundtruth.txt"
# Every sequence of the data set comes from a DAVIS240C; frames, where there are any, say it again.
_SENSOR_PX = (240, 180)
_LINES = TextLayout("text", 0, (0, 1, 2, 3), power=6, whole_times=False)


class EventCameraDataset:
    """One sequence of the data set: a `Recording` of a single camera."""

    depth_range_m = None

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self.name = self.path.resolve().name
        camera = _read_calibration(self.path / "calib.txt", _sensor_size(self.path))
        self.rig = Rig("DAVIS240C", (camera,), (np.eye(4),))
        poses = self.path / _POSES
        self._trajectory = recorded_poses(poses) if poses.exists() else None

    def __repr__(self) -> str:
        return f"EventCameraDataset({summary(self)})"

    @property
    def trajectory(self) -> Trajectory:
        """`T_world_cam` over time.

        Raises:
            InputError: nobody knows it.
        """
        if self._trajectory is None:
            raise no_poses(self.path, f"no {_POSES}", self.rig)
        return self._trajectory

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """Times of the first and the last event, µs."""
        return self._events(camera).span_us(STREAM)

    def occupied_us(self, camera: int) -> list[Span]:
        """First and last event of stretches without a long silence, µs."""
        return self._events(camera).occupied_us(STREAM)

    def event_count(self, camera: int) -> int:
        """Events of the camera."""
        return self._events(camera).count(STREAM)

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`."""
        return self._events(camera).between(STREAM, t0_us, t1_us)

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """(H, W) the frame of `images.txt` nearest to a time; None where there are no frames."""
        del camera
        if not self._frames:
            return None
        name = min(self._frames, key=lambda entry: abs(entry[0] - t_us))[1]
        return read_grey(self.path / name)

    def frame_times_us(self, camera: int) -> NDArray[np.int64]:
        """(T,) times of the frames of `images.txt`, µs, in order; none where there are none."""
        del camera
        return np.array(sorted(t_us for t_us, _ in self._frames), np.int64)

    def _events(self, camera: int) -> SortedText:
        if camera != 0:
            raise InputError(f"{self.path}: no camera {camera}, there is only camera 0")
        return self._text

    @cached_property
    def _frames(self) -> list[tuple[int, str]]:
        """Time in µs and file name of each frame."""
        path = self.path / "images.txt"
        if not path.exists():
            return []
        with refused(f"{path}: needs lines `t_s file`", OSError, ValueError, OverflowError):
            words = [line.split() for line in read_text(path, TABLE_BYTES, "ascii").splitlines()]
            frames = [(round(float(t_s) * 1e6), name) for t_s, name in filter(None, words)]
        for _, name in frames:
            if not name.isprintable() or name.startswith("/") or ".." in name:
                raise InputError(f"{path}: {name[:60]!a} is not a file in this folder; correct it")
        return frames

    @cached_property
    def _text(self) -> SortedText:
        reader = SortedText(self.path / "events.txt", self.rig.cameras[0])
        reader.span_us(STREAM)  # reads and checks the whole file once, whatever is asked for first
        return reader


class SortedText(TextReader):
    """Lines `t_s x y p` of one camera, in order of time; all are checked when first read."""

    def __init__(self, path: Path, camera: Camera) -> None:
        super().__init__(path, layout=_LINES)
        self.width_px, self.height_px = self._size_px = camera.width_px, camera.height_px

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Parses and checks the file from front to back."""
        last_us = 0
        for place, events in super().scan(stream):
            if len(events):
                self._check(events, last_us, place[0])
                last_us = int(events.t_us[-1])
            yield place, events

    def _check(self, events: Events, last_us: int, offset: int) -> None:
        try:
            events.checked(*self._size_px)
        except InputError as error:
            line = self.line_at(offset)
            raise InputError(f"{self.path}, from line {line} on: {error}") from error
        if events.t_us[0] < last_us:
            raise InputError(
                f"{self.path}, line {self.line_at(offset)}: event at {events.t_us[0]} µs comes "
                f"after one at {last_us} µs: sort the events by time (stable sort)"
            )


def _sensor_size(folder: Path) -> tuple[int, int]:
    """Width and height of the frames, or of the data set's sensor where there are none."""
    frame = next(iter(sorted((folder / "images").glob("*.png"))), None)
    if frame is None:
        return _SENSOR_PX
    height_px, width_px = read_grey(frame).shape
    return width_px, height_px


def _read_calibration(path: Path, size_px: tuple[int, int]) -> Camera:
    with refused(f"{path}: cannot be read as a calibration", OSError, ValueError):
        values = [float(word) for word in read_text(path, SETTINGS_BYTES, "ascii").split()]
    if len(values) != 9:
        raise InputError(f"{path}: {len(values)} numbers; expected fx fy cx cy k1 k2 p1 p2 k3")
    fx, fy, cx, cy, *terms = values
    with located(path):
        return Camera(*size_px, fx, fy, cx, cy, "radtan", tuple(terms))
