"""A recording in memory of points in a room, seen by a pair of cameras on a turning head."""

from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from point_world import Recorded

CAMERA = Camera(120, 90, 95.0, 95.0, 60.5, 44.0)
BASELINE_M, DURATION_US = 0.1, 600_000
_POINTS, _STEPS, _POSES = 500, 1500, 301


def head_motion() -> Trajectory:
    """Sideways and up and down by some 20 cm while looking around."""
    t_us = np.linspace(0, DURATION_US, _POSES).astype(np.int64)
    s = t_us / DURATION_US
    position_m = np.stack(
        [0.35 * s - 0.15, 0.09 * np.sin(5 * s), 0.06 * np.cos(4 * s + 1)], axis=1
    )  # fmt: skip
    angles = np.stack([9 * np.sin(4 * s), 14 * s - 6, 7 * np.sin(3 * s + 0.5)], axis=1)
    quats = Rotation.from_euler("xyz", angles + np.array([25, -40, 15]), degrees=True)
    start = Rotation.from_euler("xyz", [25, -40, 15], degrees=True)
    return Trajectory(t_us, start.apply(position_m) + np.array([0.4, -0.3, 1.2]), quats.as_quat())


@cache
def head_recording(cameras: int = 2) -> Recorded:
    """Some 60,000 events of each camera, exact but for the pixels that they fall into."""
    right = np.eye(4)
    right[0, 3] = BASELINE_M
    rig = Rig("head", (CAMERA,) * cameras, (np.eye(4), right)[:cameras])
    poses = head_motion()
    streams = tuple(_events(poses, T) for T in rig.T_body_cam)
    return Recorded(rig, poses, streams, (1.0, 4.0), "head")


def _events(poses: Trajectory, T_body_cam: np.ndarray) -> Events:
    rng = np.random.default_rng(7)
    middle = poses.at(DURATION_US // 2)
    ahead = np.column_stack([rng.uniform((-1, -0.8), (1, 0.8), (_POINTS, 2)), np.ones(_POINTS)])
    points = se3.transform(middle, ahead * rng.uniform(1.1, 3.6, (_POINTS, 1)))
    t_us = np.linspace(0, DURATION_US, _STEPS).astype(np.int64)
    before, rows = None, []
    for T_world_cam, t in zip(poses.at(t_us) @ T_body_cam, t_us.tolist(), strict=True):
        uv = CAMERA.project(se3.transform(se3.inverse(T_world_cam), points))
        px = np.rint(np.nan_to_num(uv, nan=-9)).astype(np.int64)
        inside = ((px >= 0) & (px < (CAMERA.width_px, CAMERA.height_px))).all(axis=1)
        if before is not None:
            k = np.flatnonzero(inside & (px != before).any(axis=1))
            # In a step of 0.4 ms events come one after the other, as a sensor reads them out.
            late = rng.integers(0, 400, len(k))
            p = rng.integers(0, 2, len(k))
            rows.append(np.column_stack([px[k], np.full(len(k), t) + late, p]))
        before = px
    rows = np.concatenate(rows)
    x, y, t, p = rows[np.argsort(rows[:, 2], kind="stable")].T
    return Events(x.astype(np.uint16), y.astype(np.uint16), t.copy(), p.astype(np.uint8))


def written(world: Recorded, path: Path) -> Path:
    """A recording in memory as a sequence on disk."""
    with SequenceWriter(
        path, name=world.name, rig=world.rig, trajectory=world.trajectory, config={},
        depth_range_m=world.depth_range_m,
    ) as writer:  # fmt: skip
        for camera, events in enumerate(world.streams):
            writer.append_events(camera, events)
    return path
