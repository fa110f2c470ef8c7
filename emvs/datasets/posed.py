"""A recording put together from files: event streams, a rig, poses, and ground truth if any.

Every data set is one of these; the modules beside this one only say which file is what.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events, count_late
from eventsweep.emvs.data.image_stores import FrameCamera
from eventsweep.emvs.data.occupied import Span
from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.data.recording import no_poses, summary
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import open_events
from eventsweep.emvs.formats.blocks import BlockReader
from eventsweep.emvs.formats.tables.columns import ColumnMap
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory


class DepthTruth(Protocol):
    """Depth that a data set gives for its first camera."""

    @property
    def t_us(self) -> NDArray[np.int64]:
        """(T,) times, µs."""

    def view_depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in camera 0's undistorted view at one of the times, m; else NaN."""


@dataclass
class EventSource:
    """One camera's events: a stream of a file, on the recording's clock.

    A file's only stream needs no name; `shift_us` is added to its times, and `columns` says which
    is what. `late` counts events earlier than one before them, in what `chunks` has given.
    """

    path: Path
    stream: str = ""
    shift_us: int = 0
    columns: ColumnMap | None = None
    late: int = field(default=0, init=False)
    _span_us: tuple[int, int] | None = field(default=None, init=False, repr=False)

    @cached_property
    def reader(self) -> BlockReader:
        """The open file."""
        reader = open_events(self.path, self.columns)
        if not self.stream and len(reader.streams) != 1:
            raise InputError(
                f"{self.path}: several streams, {', '.join(reader.streams)}; choose one with the "
                "key `stream`"
            )
        self.stream = self.stream or reader.streams[0]
        if self.stream not in reader.streams:
            raise InputError(
                f"{self.path}: no stream {self.stream!r}; there are {', '.join(reader.streams)}"
            )
        return reader

    def span_us(self) -> tuple[int, int]:
        """Earliest and latest event, µs."""
        if self._span_us is None:
            first_us, last_us = self.reader.span_us(self._name)
            self._span_us = first_us + self.shift_us, last_us + self.shift_us
        return self._span_us

    def between(self, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`, as the file holds them."""
        events = self.reader.between(self._name, t0_us - self.shift_us, t1_us - self.shift_us)
        return events.shifted(self.shift_us)

    def occupied_us(self) -> list[Span]:
        """First and last event of stretches without a long silence, µs."""
        spans = self.reader.occupied_us(self._name)
        return [(first + self.shift_us, last + self.shift_us) for first, last in spans]

    def chunks(self, max_events: int = 1 << 20) -> Iterator[Events]:
        """All events in file order, in packets."""
        self.late, latest_us = 0, 0
        for events in self.reader.chunks(self._name, max_events):
            self.late += count_late(events.t_us, latest_us)
            latest_us = max(latest_us, int(events.t_us.max()))
            yield events.shifted(self.shift_us)

    @property
    def share(self) -> float:
        """How much of it `chunks` has read, 0 to 1, for a bar that moves."""
        return self.reader.share(self._name)

    @property
    def _name(self) -> str:
        """The stream's name, which an unopened file may not have given yet."""
        return self.reader.streams[0] if not self.stream else self.stream


@dataclass(frozen=True)
class PosedRecording:
    """A `Recording` of files that other people laid out.

    Attributes:
        path: the folder or file that was opened.
        layout: what it was recognised as.
        poses: `T_world_body` over time, or what is missing where nobody knows it.
        sources: events per camera, in the order of the rig.
        truth: ground truth of camera 0, if there is some.
        depth_range_m: nearest and farthest depth, where known.
        beside: finds ordinary cameras beside the event cameras, when somebody asks for them.
    """

    path: Path
    layout: str
    name: str
    rig: Rig
    poses: Trajectory | str
    sources: tuple[EventSource, ...]
    truth: DepthTruth | None = None
    depth_range_m: tuple[float, float] | None = None
    beside: Callable[[], tuple[FrameCamera, ...]] = tuple

    def __post_init__(self) -> None:
        if len(self.sources) != len(self.rig):
            raise InputError(
                f"{self.path}: {len(self.sources)} event streams for {len(self.rig)} calibrated "
                "cameras; needs one per camera: choose the calibration's cameras, or name a file "
                "of each as calibration.file = [...]"
            )

    def __repr__(self) -> str:
        return f"PosedRecording({self.layout}: {summary(self)})"

    @property
    def frame_cameras(self) -> tuple[FrameCamera, ...]:
        """The ordinary cameras beside the event cameras.

        Raises:
            InputError: images without times, or of another number.
        """
        return self.beside()

    @property
    def trajectory(self) -> Trajectory:
        """`T_world_body` over time.

        Raises:
            InputError: nobody knows it.
        """
        if isinstance(self.poses, str):
            raise no_poses(self.path, self.poses, self.rig)
        return self.poses

    def tracked_at(self, T_body_camera: NDArray[np.float64]) -> PosedRecording:
        """The recording whose poses were of a body that carries the first camera there."""
        if isinstance(self.poses, str):
            return self
        return replace(self, poses=self.poses.times(T_body_camera))

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """Times of the first and the last event, µs."""
        return self._source(camera).span_us()

    def occupied_us(self, camera: int) -> list[Span]:
        """First and last event of a camera's stretches without a long silence, µs."""
        return self._source(camera).occupied_us()

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`."""
        source, sensor = self._source(camera), self.rig.cameras[camera]
        try:
            return source.between(t0_us, t1_us).checked(sensor.width_px, sensor.height_px)
        except InputError as error:
            text = str(error)
            raise InputError(
                text if str(source.path) in text else f"{source.path}, from {t0_us} µs: {text}"
            ) from error

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """None: pictures are not read."""
        del camera, t_us
        return None

    def truth_times_us(self, camera: int) -> NDArray[np.int64]:
        """(T,) times with ground truth, µs; none for cameras beside the first."""
        return np.empty(0, np.int64) if self.truth is None or camera else self.truth.t_us

    @property
    def truth_any_time(self) -> bool:
        """Whether there is truth at any time that the poses cover, not only at those listed."""
        return bool(getattr(self.truth, "any_time", False))

    def truth_view_depth_m(self, camera: int, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in the camera's undistorted view, m; not finite where unknown."""
        times_us = self.truth_times_us(camera)
        known = t_us in times_us or (self.truth_any_time and not camera)
        if self.truth is None or not known:
            near = "" if not len(times_us) else (
                f"; the nearest time is {times_us[np.argmin(np.abs(times_us - t_us))]} µs"
            )  # fmt: skip
            raise InputError(f"{self.path}: no ground truth of camera {camera} at {t_us} µs{near}")
        return self.truth.view_depth_m(t_us)

    def _source(self, camera: int) -> EventSource:
        if not 0 <= camera < len(self.sources):
            raise InputError(f"{self.path}: no camera {camera}, there are {len(self.sources)}")
        return self.sources[camera]


def recorded_poses(
    path: Path, unit: str = "", shift_us: int = 0,
    how: str = "name it in a recording.toml with poses.unit =",
) -> Trajectory:  # fmt: skip
    """The poses of a recording's file, whose unit only a `recording.toml` can state."""
    with unit_stated(how):
        return read_poses(path, unit, shift_us)


@contextmanager
def unit_stated(how: str) -> Iterator[None]:
    """Says how a unit of poses can be stated where nothing is called `unit`."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error).replace("set unit to", how)) from error


CONVERTED = "run `eventsweep convert FILE OUT --to tum` with unit"
"""How, where poses are given as a file alone."""


def find_one(folder: Path, patterns: Iterable[str], what: str) -> Path:
    """The one file that matches; the first pattern that matches decides."""
    patterns = tuple(patterns)
    match = find_optional(folder, patterns, what)
    if match is None:
        raise InputError(f"{folder}: lacks {what}; needs {' or '.join(patterns)}")
    return match


def find_optional(folder: Path, patterns: Iterable[str], what: str) -> Path | None:
    """The one file that matches, or None."""
    for pattern in patterns:
        matches = sorted(path for path in folder.glob(pattern) if path.is_file())
        if len(matches) > 1:
            names = ", ".join(path.name for path in matches[:4])
            raise InputError(
                f"{folder}: {len(matches)} candidates for {what} ({names}); keep one, or name it "
                "in a recording.toml"
            )
        if matches:
            return matches[0]
    return None


def find_folder(folder: Path, patterns: Iterable[str], side: str) -> Path | None:
    """The first folder that matches; `{}` in a pattern stands for the side."""
    places = (path for name in patterns for path in sorted(folder.glob(name.format(side))))
    return next((path for path in places if path.is_dir()), None)
