"""A run as a recording for the Rerun viewer: camera, frames, depth and clouds in one world.

Needs the package `rerun-sdk`, the extra `rerun`. Windows are written one after
another, so a recording may be larger than memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.point_cloud import back_project_map, without_outliers
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.dsi.slices import Slices
from eventsweep.emvs.errors import InputError, heed_interrupt
from eventsweep.emvs.geometry.camera import Camera
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
