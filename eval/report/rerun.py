"""A run as a recording for the Rerun viewer: camera, frames, depth and clouds in one world.

Needs the package `rerun-sdk`, the extra `rerun`. Windows are written one after
another, so a recording may be larger than memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.point_cloud import back_project_map, without_outliers
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.errors import InputError, heed_interrupt
from eventsweep.emvs.maps.folder import StoredMap, StoredWindow
from eventsweep.emvs.utils.outputs import files_together
from eventsweep.emvs.utils.release import install_extra
from eventsweep.eval.config import EvalConfig
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


def write_rerun(folder: Path) -> Path:
    """Writes `recording.rrd` into the folder of a run or a map.

    Entities: `CASE/camera` (pose and pinhole of the reference view), below it `frame`, `true_depth`
    and `depth/METHOD`, m, and `CASE/cloud/METHOD`, points in the world, m. Times are those of the
    reference views.
    """
    viewer, maps = _library(), find_maps(folder)
    with files_together(folder, (FILE_NAME,)) as staged:
        stream = viewer.RecordingStream("eventsweep", recording_id=folder.resolve().name)
        stream.save(staged / FILE_NAME)
        stream.log("/", viewer.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for case, stored in maps.items():
            log = _Log(viewer, stream, case)
            for window in stored.windows:
                _log_window(log, folder, stored, window)
        stream.flush()
        stream.disconnect()
    return folder / FILE_NAME


def _library() -> Any:
    try:
        return import_module("rerun")
    except ImportError as error:
        heed_interrupt(error)
        raise InputError(
            f"recordings for the Rerun viewer need it: {install_extra('rerun')}"
        ) from error


@dataclass(frozen=True)
class _Log:
    """Where entities of one case go."""

    viewer: Any
    stream: Any
    case: str

    def __call__(self, entity: str, *what: Any) -> None:
        self.stream.log(f"{file_name(self.case)}/{entity}", *what)

    def depth(self, entity: str, depth_m: NDArray[np.floating], mask: NDArray[np.bool_]) -> None:
        """Logs a depth image, m; the viewer takes 0 for unknown."""
        known_m = np.where(mask, depth_m, 0).astype(np.float32)
        self(entity, self.viewer.DepthImage(known_m, meter=1.0))


def _log_window(log: _Log, folder: Path, stored: StoredMap, window: StoredWindow) -> None:
    log.stream.set_time(TIMELINE, duration=1e-6 * window.info.t_ref_us)
    first = window.depth_map(window.info.methods[0])
    _log_view(log, stored, first)
    mapped = (window.depth_map(method) for method in window.info.methods)
    for depth_map in (*mapped, *other_maps(folder, log.case, window)):
        entity = f"camera/depth/{file_name(depth_map.method)}"
        log.depth(entity, depth_map.depth_m, depth_map.mask)
        _log_cloud(log, stored, depth_map)


def _log_view(log: _Log, stored: StoredMap, depth_map: DepthMap) -> None:
    camera, place = depth_map.camera, depth_map.T_world_rv
    log(
        "camera",
        log.viewer.Transform3D(translation=place[:3, 3], mat3x3=place[:3, :3]),
        log.viewer.Pinhole(
            resolution=[camera.width_px, camera.height_px], image_from_camera=camera.K,
            camera_xyz=log.viewer.ViewCoordinates.RDF,
        ),
    )  # fmt: skip
    recording = existing_recording(stored)
    # Frames and ground truth are camera 0's: they say nothing of a view of its own.
    if recording is None or not stored.info.config.is_camera_0_view:
        return
    frame = recording.frame(0, depth_map.t_us)
    if frame is not None:
        seen = on_view(frame, recording.rig.cameras[0])
        log("camera/frame", log.viewer.Image(seen, color_model="L"))
    if isinstance(recording, Scored) and has_truth(recording, depth_map.t_us, EvalConfig()):
        truth = truth_of(recording, depth_map.t_us, EvalConfig())
        log.depth("camera/true_depth", truth.depth_m, truth.scored)


def _log_cloud(log: _Log, stored: StoredMap, depth_map: DepthMap) -> None:
    config = stored.info.config
    cloud = without_outliers(back_project_map(depth_map), config.radius_m, config.radius_neighbours)
    radius = log.viewer.Radius.ui_points(_POINT_PX / 2)
    points = log.viewer.Points3D(cloud.points_world, colors=cloud.colours, radii=radius)
    log(f"cloud/{file_name(depth_map.method)}", points)
