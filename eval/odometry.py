"""Tracks a recording into a folder: poses, what happened, the cloud of all maps, and the page."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.point_cloud import (
    PointCloud,
    VoxelCloud,
    back_project_map,
    without_outliers,
    write_ply,
)
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.odometry.config import TrackConfig
from eventsweep.emvs.odometry.online import OnlineMap
from eventsweep.emvs.odometry.recorded import Tracked, track
from eventsweep.emvs.odometry.tracker import Status
from eventsweep.emvs.utils.outputs import atomic_dir, inputs_of
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.found_poses import write_failure
from eventsweep.eval.progress import Display
from eventsweep.eval.report.html import REPORT_NAME
from eventsweep.eval.report.track_page import track_page

SCHEMA_VERSION = 1
_VOXEL_M, _RADIUS_M, _NEIGHBOURS = 0.01, 0.05, 3


def track_recording(
    recording: Recording, path: Path, out: Path, config: TrackConfig, progress: Display, *,
    first_map: DepthMap | None = None, T_world_body: NDArray[np.float64] | None = None,
    force: bool = False,
) -> Tracked:  # fmt: skip
    """Writes `trajectory.txt`, `track.json`, `cloud.ply` and `report.html`; returns the poses."""
    voxels = VoxelCloud(_VOXEL_M)
    with atomic_dir(out, force=force, inputs=inputs_of(path)) as folder:
        with progress.stage("track", 1.0) as update:
            tracked = track(
                recording, config, first_map=first_map, T_world_body=T_world_body,
                on_map=_into(voxels), progress=_moving(update),
            )  # fmt: skip
            update(1.0, f"{len(tracked.trajectory)} poses, {tracked.maps} maps")
        cloud, _ = voxels.cloud()
        write_tum(folder / "trajectory.txt", tracked.trajectory)
        write_ply(folder / "cloud.ply", cloud)
        facts = {
            "schema_version": SCHEMA_VERSION,
            "recording": recording.name,
            "config": config.model_dump(mode="json"),
            "versions": versions(),
            **facts_of(tracked),
        }
        text = json.dumps(facts, indent=2, ensure_ascii=False) + "\n"
        (folder / "track.json").write_text(text, encoding="utf-8")
        page = track_page(recording.name, tracked, cloud)
        (folder / REPORT_NAME).write_text(page, encoding="utf-8")
    return tracked


def track_stage(progress: Display) -> Callable[[Path, Path], None]:
    """Tracks a recording into a folder as a stage of a run, in which a failure is a result."""

    def stage(path: Path, out: Path) -> None:
        try:
            track_recording(open_recording(path), path, out, TrackConfig(), progress)
        except InputError as error:
            write_failure(out, error)

    return stage


def facts_of(tracked: Tracked) -> dict[str, Any]:
    """Plain values of `track.json`."""
    steps_m = np.diff(tracked.trajectory.positions_m, axis=0)
    return {
        "span_us": list(tracked.span_us),
        "poses": len(tracked.trajectory),
        "poses_by_status": {
            status.value: sum(each is status for each in tracked.statuses) for status in Status
        },
        "covered": tracked.covered,
        "way_m": float(np.linalg.norm(steps_m, axis=1).sum()),
        "maps": tracked.maps,
        "changes": [
            {"t_us": change.t_us, "status": change.status.value, "reason": change.reason}
            for change in tracked.changes
        ],
    }


def _into(voxels: VoxelCloud) -> Callable[[OnlineMap], None]:
    def add(online: OnlineMap) -> None:
        for depth_map in online.result.depth_maps.values() if online.result else ():
            cloud: PointCloud = back_project_map(depth_map)
            voxels.add(without_outliers(cloud, _RADIUS_M, _NEIGHBOURS))

    return add


def _moving(update: Callable[[float, str], None]) -> Callable[[str, int, int], None]:
    def show(_stage: str, done: int, total: int) -> None:
        update(done / max(total, 1), f"{done / 1000:.1f} of {total / 1000:.1f} s")

    return show
