"""A slanted plane of points before a turned rig with lenses, as a sequence of ours with truth.

Everything is exact by construction: points are projected through the lens at many instants, and an
event is where a point's pixel changes. So every layout that claims to hold the sequence must map to
the same depth as ours.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.datasets.export import RecordingExport, write_recording
from eventsweep.emvs.datasets.raw_streams import open_readable
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory

WIDTH, HEIGHT, FOCAL = 96, 64, 80.0
LENSES = {
    "pinhole": (), "kb4": (-0.05, 0.02, -0.01, 0.003), "radtan": (-0.25, 0.08, 0.001, -0.0015),
}  # fmt: skip
SPAN_US = (0, 500_000)
TRUTH_US = (200_000, 250_000, 300_000)
NORMAL = np.array([0.15, -0.1, 1.0])
DISTANCE_M = 2.0  # NORMAL . X = DISTANCE_M, world frame
STEPS = 1500


def lens(model):
    return Camera(WIDTH, HEIGHT, FOCAL, FOCAL + 1, 47.3, 31.1, model, LENSES[model])


def turned(degrees, position_m):
    quat = Rotation.from_euler("xyz", degrees, degrees=True).as_quat()
    return se3.from_quat_xyzw(np.array(position_m, float), quat)


def rig_of(model, cameras=2):
    """Camera 0 sits turned on the body, camera 1 turned against camera 0."""
    T_body_cam0 = turned((4, -7, 11), (0.02, 0.03, -0.01))
    places = [T_body_cam0, T_body_cam0 @ turned((1.5, -2.0, 1.0), (0.1, 0.004, -0.003))]
    return Rig(f"{model}-pair", (lens(model),) * cameras, tuple(places[:cameras]))


def trajectory_of(rig, poses=26):
    """Camera 0 moves 0.4 m to the right and turns by some degrees."""
    t_us = np.linspace(*SPAN_US, poses).astype(np.int64)
    share = t_us / SPAN_US[1] - 0.5
    T_world_cam0 = np.stack([turned((3 * s, 4 * s, -2 * s), (0.4 * s, 0.03 * s, 0)) for s in share])
    return Trajectory.from_matrices(t_us, T_world_cam0 @ se3.inverse(rig.T_body_cam[0]))


def points_world(count=700, seed=3):
    """(N, 3) points of the plane, m."""
    xy = np.random.default_rng(seed).uniform((-1.6, -1.0), (1.6, 1.0), (count, 2))
    return np.column_stack([xy, (DISTANCE_M - xy @ NORMAL[:2]) / NORMAL[2]])


def events_of(camera, T_world_cam, t_us):
    """An event per point and change of pixel; `T_world_cam` (T, 4, 4) at `t_us` (T,)."""
    points = points_world()
    before, parts = None, []
    for T, t in zip(T_world_cam, t_us.tolist(), strict=True):
        uv = camera.project(se3.transform(se3.inverse(T), points))
        px = np.rint(np.nan_to_num(uv, nan=-9)).astype(np.int64)
        inside = ((px >= 0) & (px < (camera.width_px, camera.height_px))).all(axis=1)
        if before is not None:
            k = np.flatnonzero(inside & (px != before).any(axis=1))
            parts.append(np.column_stack([px[k], np.full(len(k), t), k % 2]))
        before = px
    x, y, t, p = np.concatenate(parts).T
    return Events(x.astype(np.uint16), y.astype(np.uint16), t.copy(), p.astype(np.uint8))


def plane_depth_m(T_world_cam, bearing):
    """(H, W) z-depth of the plane along bearings (H, W, 2)."""
    rays = np.concatenate([bearing, np.ones((*bearing.shape[:2], 1))], axis=-1)
    turned_rays = rays @ T_world_cam[:3, :3].T
    depth_m = (DISTANCE_M - NORMAL @ T_world_cam[:3, 3]) / (turned_rays @ NORMAL)
    return depth_m.astype(np.float32)


def plane_image(camera, T_world_cam):
    """(H, W) uint8: a smooth picture on the plane, through the camera's lens."""
    bearing = camera.bearing_table()
    depth_m = plane_depth_m(T_world_cam, bearing).astype(np.float64)
    points = np.concatenate([bearing, np.ones((*bearing.shape[:2], 1))], axis=-1)
    x, y, _ = np.moveaxis(se3.transform(T_world_cam, points * depth_m[..., None]), -1, 0)
    return np.rint(127 + 60 * np.sin(9 * x) + 60 * np.sin(11 * y)).astype(np.uint8)


def write_sequence(path: Path, model: str, cameras: int = 2, steps: int = STEPS) -> Path:
    """Writes the sequence in our layout, with truth at `TRUTH_US`."""
    rig = rig_of(model, cameras)
    trajectory = trajectory_of(rig)
    t_us = np.linspace(*SPAN_US, steps).astype(np.int64)
    with SequenceWriter(
        path, name="plane", rig=rig, trajectory=trajectory, config={}, depth_range_m=(1.0, 4.0)
    ) as writer:
        for k, camera in enumerate(rig.cameras):
            writer.append_events(
                k, events_of(camera, trajectory.at(t_us) @ rig.T_body_cam[k], t_us)
            )
            for t in TRUTH_US:
                T = trajectory.at(t) @ rig.T_body_cam[k]
                depth_m = plane_depth_m(T, camera.bearing_table())
                view_m = plane_depth_m(T, camera.undistorted().bearing_table())
                more = {} if model == "pinhole" else {"view_depth_m": view_m}
                writer.append_truth(k, t, depth_m, np.zeros(depth_m.shape, np.uint8), more)
    return path


def rewritten(ours: Path, out: Path, kind: str, shift_us: int = 0) -> Path:
    readable = open_readable(ours)
    sources = tuple(source for _, source in readable.streams)
    job = RecordingExport(readable.recording, sources, shift_us, lambda _: None)
    write_recording(job, out, kind)
    return out
