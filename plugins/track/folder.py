"""Tracks a recording into a folder: poses, what happened, the cloud of all maps, and the page."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.data.recording import Recording, events_span_us
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.point_cloud import (
    PointCloud,
    VoxelCloud,
    back_project_map,
    without_outliers,
    write_ply,
)
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.maps.identity import content_hash
from eventsweep.emvs.utils.files import made_parent, work_folder
from eventsweep.emvs.utils.outputs import atomic_dir, check_output, real
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.jobs.code_version import code_version
from eventsweep.eval.progress import Display
from eventsweep.eval.report.html import REPORT_NAME
from eventsweep.eval.report.rerun import View
from eventsweep.eval.results.results import write_results
from eventsweep.eval.scoring.trajectories.sources import Source
from eventsweep.plugins.track.odometry.checkpoint import State, read_state, write_state
from eventsweep.plugins.track.odometry.config import TrackConfig
from eventsweep.plugins.track.odometry.online import OnlineMap
from eventsweep.plugins.track.odometry.pose import Pose, Status
from eventsweep.plugins.track.odometry.recorded import Tracked, track
from eventsweep.plugins.track.page import maps_words, track_page
from eventsweep.plugins.track.scored import Judged, judged

SCHEMA_VERSION = 1
_KEEP_EVERY_S, _KEEP_SHARE = 5.0, 0.05
_SHOWN_US = 33_333  # between two poses of a view
_VOXEL_M, _RADIUS_M, _NEIGHBOURS = 0.01, 0.05, 3


class Written(NamedTuple):
    """What was written: the track, its plain values, and its score if it was asked for."""

    tracked: Tracked
    facts: dict[str, Any]
    score: Judged | None


def track_recording(
    recording: Recording, path: Path, out: Path, config: TrackConfig, progress: Display, *,
    first_map: DepthMap | None = None, T_world_body: NDArray[np.float64] | None = None,
    truth: Source | str = "", force: bool = False, view: View | None = None, command: str = "",
) -> Written:  # fmt: skip
    """Writes poses, covariances, `track.json`, `cloud.ply` and `report.html`, and scores if asked.

    Scores need true poses; a text says why there are none, an empty one that nobody asked. The page
    says which `command` made it.

    While it works, its state is kept in a hidden folder beside `out`: after a kill the same call
    goes on from there, and ends with the same bytes.
    """
    read = [truth.path] if isinstance(truth, Source) else []
    voxels, inputs = VoxelCloud(_VOXEL_M), (path, config, *read)
    seen = None if view is None else _Seen(view, recording)
    check_output(out, force=force)

    @cache
    def identity() -> str:
        return _identity(recording, config, first_map, T_world_body)

    with (
        _kept(out, voxels, identity) as kept,
        atomic_dir(out, force=force, inputs=inputs) as folder,
    ):
        with progress.stage("track", 1.0) as update:
            tracked = track(
                recording, config, first_map=first_map, T_world_body=T_world_body,
                on_map=_into(voxels, seen), on_pose=None if seen is None else seen.pose,
                progress=_moving(update), checkpoints=kept,
            )  # fmt: skip
            update(1.0, f"{len(tracked.trajectory)} poses, {maps_words(tracked)}")
        cloud, _ = voxels.cloud()
        write_tum(folder / "trajectory.txt", tracked.trajectory)
        write_covariances(folder / "covariances.txt", tracked)
        write_ply(folder / "cloud.ply", cloud)
        score = judged(tracked.trajectory, truth) if truth else None
        found = facts_of(tracked) | ({} if score is None else {"score": score.facts()})
        results = None if score is None else score.results(recording.name)
        if results is not None:
            write_results(folder, results)
        facts = {
            "schema_version": SCHEMA_VERSION,
            "recording": recording.name,
            "config": config.model_dump(mode="json"),
            "versions": versions(),
            **found,
        }
        text = json.dumps(facts, indent=2, ensure_ascii=False) + "\n"
        (folder / "track.json").write_text(text, encoding="utf-8")
        page = track_page(recording.name, tracked, cloud, score, command)
        (folder / REPORT_NAME).write_text(page, encoding="utf-8")
    return Written(tracked, found, score)


class _Kept:
    """The state of a run in a file, with the cloud of its maps so far."""

    def __init__(self, file: Path, voxels: VoxelCloud, identity: Callable[[], str]) -> None:
        self._file, self._voxels, self._identity = file, voxels, identity
        self._next_s = time.monotonic() + _KEEP_EVERY_S

    def is_due(self) -> bool:
        """Whether the last state is old enough."""
        return time.monotonic() >= self._next_s

    def save(self, state: State) -> None:
        """Keeps a state."""
        own = {"of": self._identity(), "voxels": self._voxels.state()}
        began_s = time.monotonic()
        write_state(self._file, {**own, "state": state})
        ended_s = time.monotonic()
        self._next_s = ended_s + max(_KEEP_EVERY_S, (ended_s - began_s) / _KEEP_SHARE)

    def load(self) -> State | None:
        """The state of the same work; without one the work begins anew and ends the same."""
        try:
            kept = read_state(self._file) if self._file.exists() else None
        except InputError:
            return None
        if kept is None or kept.get("of") != self._identity():
            return None
        self._voxels.restore(kept["voxels"])
        state: State = kept["state"]
        return state


@contextmanager
def _kept(out: Path, voxels: VoxelCloud, identity: Callable[[], str]) -> Iterator[_Kept]:
    """Where the state of a run is kept; nothing stays of one that ended, in whatever way."""
    place = real(out)
    with made_parent(place), work_folder(place, resume=True) as work:
        file = work / "state.npz"
        try:
            yield _Kept(file, voxels, identity)
        except Exception:  # a kill or an interrupt is none
            file.unlink(missing_ok=True)
            raise


def _identity(
    recording: Recording, config: TrackConfig, first_map: DepthMap | None,
    T_world_body: NDArray[np.float64] | None,
) -> str:  # fmt: skip
    """A hash of all that decides poses and cloud."""
    first_us, last_us = events_span_us(recording)
    facts = {
        "recording": content_hash(
            recording, first_us, last_us + 1, poses=False, imu=config.gyroscope
        ),
        "config": config.model_dump(mode="json", exclude={"threads"}),
        "start": None if T_world_body is None else np.asarray(T_world_body).tolist(),
        "versions": versions(),
        "code": code_version(["eventsweep.plugins.track.odometry.recorded"]),
    }
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    if first_map is not None:
        digest.update(json.dumps([first_map.t_us, first_map.camera.to_json()]).encode())
        for array in (first_map.depth_m, first_map.mask, first_map.T_world_rv):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def write_covariances(path: Path, tracked: Tracked) -> None:
    """Writes a line per pose: its time, s, and the upper triangle of its covariance, by rows."""
    t_s = tracked.trajectory.t_us / 1e6
    triangles = tracked.covariances[:, *np.triu_indices(6)]
    np.savetxt(
        path, np.column_stack([t_s, triangles]), fmt=["%.6f"] + ["%.9e"] * triangles.shape[1],
        header="t_s, then the upper triangle by rows of the (6, 6) covariance of errors of "
        "position [m] and turn [rad] along the world's axes: "
        "p_true = p + dp, R_true = exp(dtheta) R",
    )  # fmt: skip


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
        "silent_us": tracked.silent_us,
        "way_m": float(np.linalg.norm(steps_m, axis=1).sum()),
        "maps": tracked.maps,
        "changes": [
            {"t_us": change.t_us, "status": change.status.value, "reason": change.reason}
            for change in tracked.changes
        ],
    }


def _into(voxels: VoxelCloud, seen: _Seen | None) -> Callable[[OnlineMap], None]:
    def add(online: OnlineMap) -> None:
        for depth_map in online.result.depth_maps.values() if online.result else ():
            cloud: PointCloud = back_project_map(depth_map)
            voxels.add(without_outliers(cloud, _RADIUS_M, _NEIGHBOURS))
        if seen is not None:
            seen.map(online)

    return add


class _Seen:
    """Shows poses, the events between them, and maps in a viewer."""

    def __init__(self, view: View, recording: Recording) -> None:
        self._view, self._recording, self._until_us = view, recording, 0

    def pose(self, pose: Pose) -> None:
        """Shows a pose where some time has gone by, and the events since the one shown before."""
        before_us = max(self._until_us, pose.t_us - _SHOWN_US)
        if pose.t_us - self._until_us >= _SHOWN_US:
            name, self._until_us = self._recording.name, pose.t_us
            self._view.body(name, self._recording, pose.t_us, pose.T_world_body)
            self._view.events(name, self._recording, before_us, pose.t_us)

    def map(self, online: OnlineMap) -> None:
        """Shows a map, where it could be made."""
        if online.result is not None:
            self._view.window(self._recording.name, online.result)


def _moving(update: Callable[[float, str], None]) -> Callable[[str, int, int], None]:
    def show(_stage: str, done: int, total: int) -> None:
        update(done / max(total, 1), f"{done / 1000:.1f} of {total / 1000:.1f} s")

    return show
