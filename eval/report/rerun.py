"""The Rerun viewer: a run as a recording, and work in progress, in one world.

Needs the package `rerun-sdk`, the extra `rerun`. Times are the recording's. Windows are written one
after another, so a recording may be larger than memory.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.point_cloud import back_project_map, without_outliers
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.dsi.slices import Slices
from eventsweep.emvs.errors import InputError, heed_interrupt, one_line
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.maps.folder import StoredMap, StoredWindow, read_map
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.outputs import files_together
from eventsweep.emvs.utils.release import install_extra
from eventsweep.emvs.window_result import WindowResult
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.figures.colormaps import events_scale
from eventsweep.eval.figures.images import events_image
from eventsweep.eval.pipeline import Watch
from eventsweep.eval.scoring.regions import on_view
from eventsweep.eval.scoring.run_folder import (
    Scored,
    existing_recording,
    find_maps,
    has_truth,
    other_maps,
    truth_of,
)

FILE_NAME = "recording.rrd"
TIMELINE = "recording_time"
_POINT_PX = 2.0
_STEP_US, _MOST_STEPS = 33_333, 200  # of a sequence that is shown
_MOST_PLACES = 2000  # of a path that is drawn


def write_rerun(folder: Path) -> Path:
    """Writes `recording.rrd` into the folder of a run or a map.

    Entities: `CASE/camera` (pose and pinhole of the reference view), below it `frame`, `true_depth`
    and `depth/METHOD`, m; `CASE/cloud/METHOD`, points in the world, m; `CASE/dsi/METHOD`, votes of
    one image row by plane and column. Times are those of the reference views.
    """
    viewer, maps = library(), find_maps(folder)
    with files_together(folder, (FILE_NAME,)) as staged:
        stream = viewer.RecordingStream("eventsweep", recording_id=folder.resolve().name)
        stream.save(staged / FILE_NAME)
        stream.log("/", viewer.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for case, stored in maps.items():
            log, recording = Log(viewer, stream, case), existing_recording(stored)
            for window in stored.windows:
                log_window(log, stored, window, recording, other_maps(folder, case, window))
        stream.flush()
        stream.disconnect()
    return folder / FILE_NAME


def library() -> Any:
    """The package `rerun`.

    Raises:
        InputError: it is not installed; says how to.
    """
    try:
        return import_module("rerun")
    except ImportError as error:
        heed_interrupt(error)
        raise InputError(
            f"recordings for the Rerun viewer need it: {install_extra('rerun')}"
        ) from error


@dataclass(frozen=True)
class Log:
    """Where entities of one case go."""

    viewer: Any
    stream: Any
    case: str

    def __call__(self, entity: str, *what: Any) -> None:
        """Logs components of an entity at the time that was set last."""
        self.stream.log(f"{file_name(self.case)}/{entity}", *what)

    def at(self, t_us: int) -> None:
        """Sets the time of what is logged next, µs."""
        self.stream.set_time(TIMELINE, duration=1e-6 * t_us)

    def camera(self, entity: str, camera: Camera, T_world_cam: NDArray[np.floating]) -> None:
        """Logs a camera and where it is."""
        self(
            entity,
            self.viewer.Transform3D(translation=T_world_cam[:3, 3], mat3x3=T_world_cam[:3, :3]),
            self.viewer.Pinhole(
                resolution=[camera.width_px, camera.height_px], image_from_camera=camera.K,
                camera_xyz=self.viewer.ViewCoordinates.RDF,
            ),
        )  # fmt: skip

    def depth(self, entity: str, depth_m: NDArray[np.floating], mask: NDArray[np.bool_]) -> None:
        """Logs a depth image, m; the viewer takes 0 for unknown."""
        known_m = np.where(mask, depth_m, 0).astype(np.float32)
        self(entity, self.viewer.DepthImage(known_m, meter=1.0))

    def depth_map(self, depth_map: DepthMap, config: MapperConfig) -> None:
        """Logs a method's depth and its cloud."""
        name = file_name(depth_map.method)
        self.depth(f"camera/depth/{name}", depth_map.depth_m, depth_map.mask)
        cloud = back_project_map(depth_map)
        cloud = without_outliers(cloud, config.radius_m, config.radius_neighbours)
        radius = self.viewer.Radius.ui_points(_POINT_PX / 2)
        points = self.viewer.Points3D(cloud.points_world, colors=cloud.colours, radii=radius)
        self(f"cloud/{name}", points)

    def slices(self, slices: Slices) -> None:
        """Logs one image row of every fused volume, far planes first."""
        order = np.argsort(slices.rho)
        for method, votes in slices.values.items():
            if len(votes):  # of a method without a volume there is none
                entity = self.viewer.Tensor(votes[order], dim_names=("plane", "column"))
                self(f"dsi/{file_name(method)}", entity)


def log_window(
    log: Log, stored: StoredMap, window: StoredWindow, recording: Recording | None,
    others: Sequence[DepthMap] = (),
) -> None:  # fmt: skip
    """Logs a stored window at its reference time; the recording is None where it is gone."""
    log.at(window.info.t_ref_us)
    maps = [window.depth_map(method) for method in window.info.methods]
    _log_view(log, stored.info.config, recording, maps[0])
    for depth_map in (*maps, *others):
        log.depth_map(depth_map, stored.info.config)
    log.slices(window.slices)


def _log_view(
    log: Log, config: MapperConfig, recording: Recording | None, depth_map: DepthMap
) -> None:
    log.camera("camera", depth_map.camera, depth_map.T_world_rv)
    # Frames and ground truth are camera 0's: they say nothing of a view of its own.
    if recording is None or not config.is_camera_0_view:
        return
    frame = recording.frame(0, depth_map.t_us)
    if frame is not None:
        seen = on_view(frame, recording.rig.cameras[0])
        log("camera/frame", log.viewer.Image(seen, color_model="L"))
    if isinstance(recording, Scored) and has_truth(recording, depth_map.t_us, EvalConfig()):
        truth = truth_of(recording, depth_map.t_us, EvalConfig())
        log.depth("camera/true_depth", truth.depth_m, truth.scored)


class View(Watch):
    """A viewer that is fed while work goes on.

    Entities are those of `write_rerun`, and `CASE/sensor`: camera 0 with its `frame` and `events`,
    and `CASE/path`, the way of the body so far.
    """

    def __init__(self, viewer: Any, stream: Any) -> None:
        self._viewer, self._stream = viewer, stream
        self._recordings: dict[str, Recording] = {}
        self._paths: dict[str, list[NDArray[np.float64]]] = {}
        self._frame = np.empty((0, 0), np.uint8)

    def sequence(self, case: str, folder: Path) -> None:
        """Shows what camera 0 saw, where it was, in at most 200 steps."""
        recording = self._recordings[case] = open_recording(folder)
        first_us, last_us = recording.event_span_us(0)
        step_us = max(_STEP_US, -(-(last_us + 1 - first_us) // _MOST_STEPS))
        trajectory = recording.trajectory
        for t_us in range(first_us, last_us + 1, step_us):
            end_us = min(t_us + step_us, last_us + 1)
            inside_us = int(np.clip(end_us - 1, *trajectory.span_us))
            self.body(case, recording, end_us, trajectory.at([inside_us])[0])
            self.events(case, recording, t_us, end_us)
        self._stream.flush()

    def maps(self, case: str, folder: Path) -> None:
        """Shows every window of a map folder."""
        stored, log = read_map(folder), self._log(case)
        for window in stored.windows:
            log_window(log, stored, window, self._recordings.get(case))
        self._stream.flush()

    def body(
        self, case: str, recording: Recording, t_us: int, T_world_body: NDArray[np.float64]
    ) -> None:
        """Shows where the body is at a time, and its path up to there."""
        log, path = self._log(case), self._paths.setdefault(case, [])
        log.at(t_us)
        log.camera("sensor", recording.rig.cameras[0], T_world_body @ recording.rig.T_body_cam[0])
        path.append(T_world_body[:3, 3])
        places = np.stack(path[:: -(-len(path) // _MOST_PLACES)])
        log("path", self._viewer.LineStrips3D([places]))

    def events(self, case: str, recording: Recording, t0_us: int, t1_us: int) -> None:
        """Shows the events of camera 0 with `t0_us <= t < t1_us`, and the frame there, if any."""
        log, camera = self._log(case), recording.rig.cameras[0]
        log.at(t1_us)
        events = recording.events(0, t0_us, t1_us)
        counts = np.zeros((2, camera.height_px, camera.width_px), np.uint32)
        np.add.at(counts, (events.p, events.y, events.x), 1)
        drawn = events_image(counts[1], counts[0], events_scale(2)).rgba()
        log("sensor/events", self._viewer.Image(drawn))
        frame = recording.frame(0, t1_us)
        if frame is not None and not (
            self._frame is not None and np.array_equal(frame, self._frame)
        ):
            log("sensor/frame", self._viewer.Image(frame, color_model="L"))
            self._frame = frame

    def window(self, case: str, result: WindowResult) -> None:
        """Shows a window as it was mapped."""
        log = self._log(case)
        log.at(result.window.t_ref_us)
        for depth_map in result.depth_maps.values():
            log.camera("camera", depth_map.camera, depth_map.T_world_rv)
            log.depth_map(depth_map, result.config)
        log.slices(result.slices)

    def _log(self, case: str) -> Log:
        return Log(self._viewer, self._stream, case)


@contextmanager
def live_view(name: str, file: Path | None = None, axes: str = "RIGHT_HAND_Z_UP") -> Iterator[View]:
    """Opens the Rerun viewer, or writes what it would show into a file, whole or not at all.

    Args:
        name: of the recording in the viewer.
        file: such as `live.rrd`; by default a window opens.
        axes: of the world, one of `rerun.ViewCoordinates`.

    Raises:
        InputError: no `rerun-sdk`, no display for a window, or a viewer that does not start.
    """
    viewer = library()
    if file is None:
        check_display(os.environ)
    with ExitStack() as stack:
        stream = viewer.RecordingStream("eventsweep", recording_id=name)
        if file is None:
            _spawn(stream)
        else:
            stream.save(stack.enter_context(atomic_path(file)))
        stream.log("/", getattr(viewer.ViewCoordinates, axes), static=True)
        try:
            yield View(viewer, stream)
        finally:
            stream.flush()
            stream.disconnect()


def check_display(environment: Mapping[str, str]) -> None:
    """Refuses to open a window where there is no display."""
    has_display = any(environment.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if sys.platform == "linux" and not has_display:
        raise InputError(
            "no display to open the Rerun viewer on (DISPLAY and WAYLAND_DISPLAY are not set): "
            "set view_file to 'live.rrd' instead, and open that file elsewhere with rerun"
        )


def _spawn(stream: Any) -> None:
    try:
        stream.spawn(hide_welcome_screen=True)
    except (RuntimeError, OSError) as error:
        raise InputError(f"the Rerun viewer did not start: {one_line(str(error))}") from error
