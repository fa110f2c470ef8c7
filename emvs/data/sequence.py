"""A sequence on disk, in our layout: read lazily, with ground truth."""

from __future__ import annotations

from functools import cached_property
from os.path import lexists
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data import manifest
from eventsweep.emvs.data.event_store import EventStoreReader
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.image_stores import (
    FRAMES_FILE,
    FrameCamera,
    FrameReader,
    Photo,
    TruthReader,
)
from eventsweep.emvs.data.occupied import Span
from eventsweep.emvs.data.poses import POSES_FILE, read_poses
from eventsweep.emvs.data.recording import no_poses, summary
from eventsweep.emvs.data.tables import IMU_FILE, Geom, ImuSamples, read_geoms, read_imu
from eventsweep.emvs.errors import InputError, check_path, located, refused
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.inputs import SETTINGS_BYTES, TABLE_BYTES, parse_json, read_text

Reader = TypeVar("Reader")


class Sequence:
    """A `Recording` with ground truth; opening reads calibration and poses, never the events.

    Attributes:
        path: the folder.
        manifest: what made the sequence.
        rig: its cameras.
    """

    def __init__(self, path: str | Path) -> None:
        check_path("path", path)
        self.path = Path(path)
        self.manifest = manifest.read(self.path)
        self.rig = _read_rig(self.path / "rig.json")
        self._trajectory = read_poses(self.path / POSES_FILE) if self.has_poses else None

    @classmethod
    def open(cls, path: str | Path) -> Sequence:
        """Opens a sequence folder.

        Raises:
            InputError: a missing, truncated or impossible file.
        """
        return cls(path)

    def __repr__(self) -> str:
        events = " + ".join(map(str, self.manifest.event_counts))
        return f"Sequence({summary(self)}, {events} events)"

    @property
    def name(self) -> str:
        """Name of the sequence."""
        return self.manifest.name

    @property
    def has_poses(self) -> bool:
        """Whether poses are stored: a video may have none, and they may be taken away or added."""
        return lexists(self.path / POSES_FILE)

    @property
    def trajectory(self) -> Trajectory:
        """`T_world_body`.

        Raises:
            InputError: no poses are stored.
        """
        if self._trajectory is None:
            raise no_poses(self.path, f"no {POSES_FILE}", self.rig)
        return self._trajectory

    @property
    def depth_range_m(self) -> tuple[float, float] | None:
        """Nearest and farthest depth, if known."""
        return self.manifest.depth_range_m

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """First and last instant of the recording, µs: a silent start belongs to it."""
        self.rig.check_camera(camera)
        return self.manifest.span_us

    def occupied_us(self, camera: int) -> list[Span]:
        """First and last event of a camera's stretches without a long silence, µs."""
        return self._of(self._events, camera).occupied_us()

    def event_count(self, camera: int) -> int:
        """Events of a camera."""
        return self._of(self._events, camera).count

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`."""
        return self._of(self._events, camera).read(t0_us, t1_us)

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """(H, W) intensity of a camera at the stored time nearest to `t_us`, if there is one."""
        times_us = self.truth_times_us(camera)
        if not len(times_us):
            return None
        return self.truth_intensity(camera, int(times_us[np.argmin(np.abs(times_us - t_us))]))

    def photo_times_us(self, camera: int) -> NDArray[np.int64]:
        """(T,) middles of the exposures of the ordinary camera in a camera's place, µs."""
        frames = self._of(self._frames, camera)
        return np.empty(0, np.int64) if frames is None else frames.t_us

    def photo(self, camera: int, t_us: int) -> Photo:
        """The ordinary camera's picture whose exposure's middle is nearest to `t_us`.

        Raises:
            InputError: no pictures are stored.
        """
        frames = self._of(self._frames, camera)
        if frames is None or not len(frames):
            raise InputError(f"{self.path}: has no frames; simulate with frames.rate_hz above 0")
        return frames.photo(int(np.argmin(np.abs(frames.t_us - t_us))))

    @cached_property
    def frame_cameras(self) -> tuple[FrameCamera, ...]:
        """The ordinary cameras beside the event cameras that took pictures."""
        rig, found = self.rig.frame_cameras, []
        for k in range(0 if rig is None else len(rig)):
            name = f"frame{k}/{FRAMES_FILE}"
            if rig is not None and name in self.manifest.files:
                place = rig.camera_names[k], rig.cameras[k], rig.T_body_cam[k]
                found.append(FrameCamera(*place, FrameReader(self.path / name)))
        return tuple(found)

    @property
    def has_imu(self) -> bool:
        """Whether inertial samples are stored."""
        return IMU_FILE in self.manifest.files

    def imu(self) -> ImuSamples:
        """The inertial samples, read when asked for.

        Raises:
            InputError: none are stored, or a damaged file.
        """
        if not self.has_imu:
            raise InputError(f"{self.path}: has no IMU samples; simulate with imu.rate_hz above 0")
        return read_imu(self.path / IMU_FILE)

    def truth_times_us(self, camera: int) -> NDArray[np.int64]:
        """Times at which ground truth is stored, µs."""
        return self._of(self._truth, camera).t_us

    def truth_depth_m(self, camera: int, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth of a camera at a stored time, m."""
        return self._of(self._truth, camera).depth_m(t_us)

    def truth_intensity(self, camera: int, t_us: int) -> NDArray[np.uint8]:
        """(H, W) linear intensity of a camera at a stored time, 0..255."""
        return self._of(self._truth, camera).intensity(t_us)

    def truth_names(self, camera: int) -> tuple[str, ...]:
        """Which optional ground truth is stored, see `emvs.data.image_stores.OPTIONAL`."""
        return self._of(self._truth, camera).optional

    def truth_flow_px(self, camera: int, t_us: int) -> NDArray[np.float32]:
        """(H, W, 2) motion of each pixel's surface point from `t_us` to the next stored time, px.

        NaN at the last time, and where the point is no longer in front of the camera.
        """
        return self._of(self._truth, camera).read("flow_px", t_us).astype(np.float32, copy=False)

    def truth_segmentation(self, camera: int, t_us: int) -> NDArray[np.int32]:
        """(H, W) id of the geom at each pixel's centre, -1 for none; `geoms` says what they are."""
        return self._of(self._truth, camera).read("segmentation", t_us).astype(np.int32, copy=False)

    def truth_dynamic(self, camera: int, t_us: int) -> NDArray[np.bool_]:
        """(H, W) whether each pixel shows something that can move by itself."""
        dynamic_ids = [geom_id for geom_id, geom in self.geoms.items() if geom.dynamic]
        return np.isin(self.truth_segmentation(camera, t_us), dynamic_ids)

    def truth_boundary(self, camera: int, t_us: int) -> NDArray[np.bool_]:
        """(H, W) whether a pixel's centre lies within 1 px of a depth discontinuity."""
        return self._of(self._truth, camera).read("boundary", t_us).astype(bool)

    def truth_twist(self, camera: int, t_us: int) -> NDArray[np.float64]:
        """(6,) velocity of the camera in its own frame: linear, m/s, then angular, rad/s."""
        return self._of(self._truth, camera).read("twist", t_us).astype(np.float64, copy=False)

    def truth_view_depth_m(self, camera: int, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in the camera's undistorted view, m: `rig.cameras[k].undistorted()`."""
        truth = self._of(self._truth, camera)
        if self.rig.cameras[camera].model == "pinhole":
            return truth.depth_m(t_us)
        return truth.read("view_depth_m", t_us).astype(np.float32, copy=False)

    @cached_property
    def geoms(self) -> dict[int, Geom]:
        """The table of a segmentation's ids."""
        return read_geoms(self.path)

    def labels(self, camera: int, t0_us: int, t1_us: int) -> NDArray[np.uint8]:
        """(N,) cause of each of `events(camera, t0_us, t1_us)`, see `sim.sensor.labels`."""
        return self._of(self._events, camera).read_extra("label", t0_us, t1_us)

    def sensor_counts(self, camera: int) -> dict[str, int]:
        """Number of a camera's events sent by cause and dropped by reason.

        Raises:
            InputError: not stored: the sensor was ideal.
        """
        path = self.path / "sensor.json"
        faults, cure = (OSError, ValueError, IndexError, TypeError), "a sensor that is not ideal"
        with refused(f"{path}: cannot be read", *faults, cure=f"; simulate with {cure}"):
            return dict(parse_json(read_text(path, TABLE_BYTES))[camera])

    def event_depth_m(self, camera: int, t0_us: int, t1_us: int) -> NDArray[np.float32]:
        """(N,) z-depth of the surface that made each of `events(camera, t0_us, t1_us)`, m."""
        return self._of(self._events, camera).read_extra("depth_m", t0_us, t1_us)

    def event_points_world(self, camera: int, t0_us: int, t1_us: int) -> NDArray[np.float64]:
        """(N, 3) surface point that made each of `events(camera, t0_us, t1_us)`, world frame, m."""
        events = self.events(camera, t0_us, t1_us)
        depth_m = self.event_depth_m(camera, t0_us, t1_us).astype(np.float64)
        pixels = np.stack([events.x, events.y], axis=-1).astype(np.float64)
        bearing = self.rig.cameras[camera].unproject(pixels)
        points_cam = np.column_stack([bearing, np.ones(len(events))]) * depth_m[:, None]
        T_world_cam = self.trajectory.at(events.t_us) @ self.rig.T_body_cam[camera]
        return se3.transform_each(T_world_cam, points_cam)

    def verify(self) -> None:
        """Compares every file with its hash.

        Raises:
            InputError: a file that changed.
        """
        manifest.check_hashes(self.path, self.manifest)

    def _of(self, readers: list[Reader], camera: int) -> Reader:
        """A camera's own reader."""
        self.rig.check_camera(camera)
        return readers[camera]

    @cached_property
    def _events(self) -> list[EventStoreReader]:
        return [
            EventStoreReader(self.path / f"cam{k}" / "events.h5", camera.width_px, camera.height_px)
            for k, camera in enumerate(self.rig.cameras)
        ]

    @cached_property
    def _frames(self) -> list[FrameReader | None]:
        names = [f"cam{k}/{FRAMES_FILE}" for k in range(len(self.rig))]
        return [FrameReader(self.path / n) if n in self.manifest.files else None for n in names]

    @cached_property
    def _truth(self) -> list[TruthReader]:
        return [TruthReader(self.path / f"cam{k}" / "truth.h5") for k in range(len(self.rig))]


def _read_rig(path: Path) -> Rig:
    with refused(f"{path}: cannot be read as a rig's calibration", OSError, ValueError):
        values = parse_json(read_text(path, SETTINGS_BYTES))
    with located(path):
        return Rig.from_json(values)
