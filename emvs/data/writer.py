"""Writes a sequence: streaming, atomic, with a manifest."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data import manifest
from eventsweep.emvs.data.event_store import EventStoreWriter
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.image_stores import FRAMES_FILE, FrameWriter, Photo, TruthWriter
from eventsweep.emvs.data.poses import POSES_FILE, write_tum
from eventsweep.emvs.data.tables import IMU_FILE, GeomTable, ImuSamples, write_geoms, write_imu
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.outputs import atomic_dir, check_output
from eventsweep.emvs.utils.runtime import versions


class SequenceWriter:
    """A context that writes a sequence folder; on an exception nothing remains.

    Until the end, what is known only then may be set as an attribute of the same name.

    Args:
        path: the folder to make.
        name: what the sequence is called.
        rig: its cameras.
        trajectory: `T_world_body`; None where nobody knows it.
        config: the configuration that made it, plain values.
        seed: the seed that made it.
        renderer: what rendered it.
        depth_range_m: nearest and farthest depth, if known.
        span_us: first and last instant of the recording; by default those of the trajectory.
        geoms: what the ids in a segmentation mean, if there is one.
        sensor_counts: per camera, what became of its events: sent by cause, dropped by reason.
        imu: inertial samples, if there is an IMU.
        force: whether an existing sequence is replaced.
        inputs: what it is made from, and which it never removes: paths, and settings with paths.

    Raises:
        InputError: the folder may not be replaced (`emvs.utils.outputs`), or cannot be written.
    """

    def __init__(
        self,
        path: Path,
        *,
        name: str,
        rig: Rig,
        trajectory: Trajectory | None,
        config: dict[str, Any],
        seed: int = 0,
        renderer: str = "none",
        depth_range_m: tuple[float, float] | None = None,
        span_us: tuple[int, int] | None = None,
        geoms: GeomTable | None = None,
        sensor_counts: Collection[dict[str, int]] | None = None,
        imu: ImuSamples | None = None,
        force: bool = False,
        inputs: Collection[object] = (),
    ) -> None:
        check_output(Path(path), force=force)
        self._path = Path(path)
        self._output = atomic_dir(self._path, force=force, inputs=inputs)
        self._name, self._rig, self.trajectory = name, rig, trajectory
        self._geoms, self._imu = geoms, imu
        self.sensor_counts = sensor_counts
        self.span_us = span_us
        self._facts: dict[str, Any] = {"configuration": config, "seed": seed, "renderer": renderer}
        self.depth_range_m = depth_range_m

    def __enter__(self) -> SequenceWriter:
        with ExitStack() as stack:
            self._folder = stack.enter_context(self._output)
            self._file_stack = stack.enter_context(ExitStack())
            self._open_files()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        with self._stack:  # which leaves no folder where anything fails in here
            self._file_stack.close()
            if error is not None:
                raise error
            self._write_end()

    def append_events(
        self,
        camera: int,
        events: Events,
        label: NDArray[np.uint8] | None = None,
        depth_m: NDArray[np.float32] | None = None,
    ) -> None:
        """Adds a packet of one camera's events, in time order.

        `label`, what made each event, and `depth_m`, z-depth of the surface that did, are (N,):
        in every packet or in none.
        """
        columns = {"label": label, "depth_m": depth_m}
        extra = {name: column for name, column in columns.items() if column is not None}
        self._events[camera].append(events, extra)

    def append_truth(
        self,
        camera: int,
        t_us: int,
        depth_m: NDArray[np.float32],
        intensity_u8: NDArray[np.uint8],
        optional: Mapping[str, NDArray[np.generic]] | None = None,
    ) -> None:
        """Adds one camera's ground truth, as `TruthWriter` in `emvs.data.image_stores` takes it."""
        self._truth[camera].append(t_us, depth_m, intensity_u8, optional)

    def append_photo(self, camera: int, photo: Photo) -> None:
        """Adds a picture of the ordinary camera in one camera's place, in order of time."""
        if camera not in self._frames:
            seen = self._rig.cameras[camera]
            path = self._folder / f"cam{camera}" / FRAMES_FILE
            writer = FrameWriter(path, seen.width_px, seen.height_px)
            self._frames[camera] = self._file_stack.enter_context(writer)
        self._frames[camera].append(photo)

    def append_beside(self, frame_camera: int, photo: Photo) -> None:
        """Adds a picture of a camera of `rig.frame_cameras`, in order of time."""
        assert self._rig.frame_cameras is not None
        seen, key = self._rig.frame_cameras.cameras[frame_camera], ~frame_camera
        if key not in self._frames:
            folder = self._folder / f"frame{frame_camera}"
            folder.mkdir()
            writer = FrameWriter(folder / FRAMES_FILE, seen.width_px, seen.height_px)
            self._frames[key] = self._file_stack.enter_context(writer)
        self._frames[key].append(photo)

    def _open_files(self) -> None:
        rig_text = json.dumps(self._rig.to_json(), indent=2) + "\n"
        (self._folder / "rig.json").write_text(rig_text, encoding="utf-8")
        self._frames: dict[int, FrameWriter] = {}
        self._events: list[EventStoreWriter] = []
        self._truth: list[TruthWriter] = []
        for k, camera in enumerate(self._rig.cameras):
            folder = self._folder / f"cam{k}"
            folder.mkdir()
            size = (camera.width_px, camera.height_px)
            self._events.append(
                self._file_stack.enter_context(EventStoreWriter(folder / "events.h5", *size))
            )
            self._truth.append(
                self._file_stack.enter_context(TruthWriter(folder / "truth.h5", *size))
            )

    def _write_end(self) -> None:
        if self.trajectory is not None:
            write_tum(self._folder / POSES_FILE, self.trajectory)
            self.span_us = self.span_us or self.trajectory.span_us
        if self._geoms is not None:
            write_geoms(self._folder, self._geoms)
        if self._imu is not None:
            write_imu(self._folder / IMU_FILE, self._imu)
        if self.sensor_counts is not None:
            counts_text = json.dumps(list(self.sensor_counts), indent=1) + "\n"
            (self._folder / "sensor.json").write_text(counts_text, encoding="utf-8")
        if self.span_us is None:
            raise InputError(f"{self._path}: a sequence without trajectory needs span_us")
        facts = manifest.Manifest(
            schema_version=manifest.SCHEMA_VERSION,
            name=self._name,
            versions=versions(),
            span_us=self.span_us,
            depth_range_m=self.depth_range_m,
            event_counts=tuple(writer.count for writer in self._events),
            files=manifest.entries(self._folder),
            **self._facts,
        )
        manifest.write(self._folder, facts)
