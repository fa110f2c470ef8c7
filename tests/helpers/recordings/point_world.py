"""Events without a renderer: points in space, projected exactly into moving cameras."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import spans_of
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording in memory."""

    rig: Rig
    trajectory: Trajectory
    streams: tuple[Events, ...]
    depth_range_m: tuple[float, float] | None = None
    name: str = "points"

    def event_span_us(self, camera):
        t_us = self.streams[camera].t_us
        return int(t_us[0]), int(t_us[-1])

    def occupied_us(self, camera):
        return spans_of(self.streams[camera].t_us)

    def events(self, camera, t0_us, t1_us):
        return self.streams[camera].between(t0_us, t1_us)


def pinhole(width=96, height=64, f=80.0):
    return Camera(width, height, f, f, (width - 1) / 2 + 0.3, (height - 1) / 2 - 0.2)


def stereo_rig(camera, baseline_m=0.1, cameras=2):
    T_body_cam = []
    for k in range(cameras):
        T = np.eye(4)
        T[0, 3] = k * baseline_m
        T_body_cam.append(T)
    return Rig("test", (camera,) * cameras, tuple(T_body_cam))


def sideways(speed_m_s=0.4, duration_us=500_000, poses=6):
    """Constant speed along x, no turning: `T_world_body` at equal steps."""
    t_us = np.linspace(0, duration_us, poses).astype(np.int64)
    position = np.zeros((poses, 3))
    position[:, 0] = speed_m_s * (t_us * 1e-6 - duration_us * 0.5e-6)
    return Trajectory(t_us, position, np.tile([0.0, 0.0, 0.0, 1.0], (poses, 1)))


def fronto_parallel(depth_m, seed=0, points=600, cameras=2, scale=1.0, on_pixels=False):
    """Random points on a plane before a rig that moves 0.4 m sideways; exact column crossings.

    Every point lies on the line of sight of a pixel row, so it moves along that row; an event falls
    at the microsecond in which it crosses a column. `on_pixels` also puts the points on pixel
    columns of camera 0 at half time. `scale` scales the world, rig and motion.
    """
    rng = np.random.default_rng(seed)
    camera, speed_m_s = pinhole(), 0.8 * scale
    rig = stereo_rig(camera, 0.1 * scale, cameras)
    trajectory = sideways(speed_m_s)
    row = rng.integers(0, camera.height_px, points)
    u_px = rng.uniform(-0.2, 1.2, points) * camera.width_px
    u_px = np.rint(u_px) if on_pixels else u_px
    x_m = (u_px - camera.cx_px) / camera.fx_px * depth_m * scale
    streams = tuple(
        _crossings(x_m, row, depth_m * scale, camera, T[0, 3], speed_m_s) for T in rig.T_body_cam
    )
    return Recorded(rig, trajectory, streams)


def _crossings(x_m, row, depth_m, camera, offset_m, speed_m_s):
    """One event per point and column: u(t) = f (x - offset - v (t - T/2)) / Z + cx."""
    columns = np.arange(camera.width_px)
    at_m = (columns - camera.cx_px) / camera.fx_px * depth_m
    t_s = (x_m[:, None] - offset_m - at_m[None, :]) / speed_m_s + 0.25
    point, column = np.nonzero((t_s >= 0) & (t_s <= 0.5))
    t_us = np.round(t_s[point, column] * 1e6).astype(np.int64)
    order = np.argsort(t_us, kind="stable")
    polarity = ((point + column) % 2).astype(np.uint8)
    return Events(
        column[order].astype(np.uint16), row[point][order].astype(np.uint16), t_us[order],
        polarity[order],
    )  # fmt: skip


def edge_stream(camera, trajectory, n, seed=0, noise=0.1):
    """Events of edge points at many depths, rounded to pixels, and uniform noise."""
    rng = np.random.default_rng(seed)
    points = camera.width_px * camera.height_px // 20
    z_m = rng.choice([0.6, 0.9, 1.4, 2.0, 3.0], points) + 0.2 * rng.random(points)
    edge_px = rng.uniform(0, 1, (points, 2)) * (camera.width_px, camera.height_px)
    start_us, end_us = trajectory.span_us
    t_us = np.sort(rng.integers(start_us, end_us + 1, n))
    which = rng.integers(0, points, n)
    moved_m = trajectory.at(t_us)[:, :2, 3]
    uv = edge_px[which] - camera.fx_px * moved_m / z_m[which][:, None]
    size = np.array([camera.width_px, camera.height_px])
    random = (rng.random(n) < noise) | ~((uv >= 0) & (uv <= size - 1)).all(axis=1)
    uv[random] = rng.uniform(0, 1, (int(random.sum()), 2)) * (size - 1)
    x, y = np.rint(uv).astype(np.uint16).T
    return Events(x.copy(), y.copy(), t_us, rng.integers(0, 2, n).astype(np.uint8))


def swinging(
    turn_deg=(6.0, 8.0, 5.0),
    way_m=(0.12, 0.08, 0.06),
    duration_us=1_200_000,
    step_us=2000,
    even=False,
):
    """A body that swings along and about three axes, each at a rate of its own, about 1 to 2 Hz.

    `even`: steady motion instead, whose rates never change.
    """
    t_us = np.arange(0, duration_us + 1, step_us)
    t_s = t_us[:, None] / 1e6

    def swing(rates_hz, phases):
        return 2 * (t_s - t_s.mean()) if even else np.sin(2 * np.pi * t_s * rates_hz + phases)

    turn = swing([1.3, 1.0, 1.7], [0.3, 1.4, 2.2]) * turn_deg
    quats = Rotation.from_rotvec(turn * np.ones((1, 3)), degrees=True).as_quat()
    place_m = swing([1.1, 1.5, 0.9], [2.0, 0.1, 1.0]) * np.array(way_m) * np.ones((1, 3))
    return Trajectory(t_us, place_m, quats)


def edge_points(trajectory, rig, points=300, seed=0, near_m=0.7, far_m=3.0):
    """A recording of random points in front of a rig that moves anyhow, in memory.

    An event falls at a pixel when a point's image crosses the middle of its column or row;
    between steps of 1 ms images move in straight lines.
    """
    rng = np.random.default_rng(seed)
    rho = rng.uniform(1 / far_m, 1 / near_m, points)
    at = rng.uniform(-0.9, 0.9, (points, 2))
    p_world = np.c_[at, np.ones(points)] / rho[:, None]
    streams = tuple(
        _entered(p_world, trajectory, camera, T)
        for camera, T in zip(rig.cameras, rig.T_body_cam, strict=True)
    )
    return Recorded(rig, trajectory, streams, (near_m, far_m))


def _entered(p_world, trajectory, camera, T_body_cam):
    first_us, last_us = trajectory.span_us
    t_us = np.arange(first_us, last_us + 1, 1000)
    T_cam_world = np.linalg.inv(trajectory.at(t_us) @ T_body_cam)
    p_cam = np.einsum("tij,pj->tpi", T_cam_world[:, :3, :3], p_world) + T_cam_world[:, None, :3, 3]
    uv = np.where(p_cam[..., 2:] > 0.1, p_cam[..., :2] / np.maximum(p_cam[..., 2:], 0.1), 1e6)
    uv = uv * [camera.fx_px, camera.fy_px] + [camera.cx_px, camera.cy_px]
    parts = []
    for axis in (0, 1):
        before, after = uv[:-1, :, axis], uv[1:, :, axis]
        k, point = np.nonzero(np.floor(before) != np.floor(after))
        edge = np.maximum(np.floor(before[k, point]), np.floor(after[k, point]))
        share = (edge - before[k, point]) / (after[k, point] - before[k, point])
        place = (1 - share)[:, None] * uv[k, point] + share[:, None] * uv[k + 1, point]
        place[:, axis] = edge
        parts.append(np.c_[place, t_us[k] + 1000 * share])
    u, v, t = np.concatenate(parts).T
    inside = (u > -0.5) & (v > -0.5) & (u < camera.width_px - 0.5) & (v < camera.height_px - 0.5)
    u, v, t = u[inside], v[inside], np.rint(t[inside]).astype(np.int64)
    order = np.argsort(t, kind="stable")
    x, y = np.rint(u[order]).astype(np.uint16), np.rint(v[order]).astype(np.uint16)
    return Events(x, y, t[order], (order % 2).astype(np.uint8))


def looking_ahead(depth_m):
    """The plane before a rig whose second camera stands in front of the first."""
    recording, ahead = fronto_parallel(depth_m), np.eye(4)
    ahead[2, 3] = 0.1
    return replace(recording, rig=Rig("ahead", recording.rig.cameras, (np.eye(4), ahead)))


def with_cameras(recording, order):
    """The recording with its cameras in another order."""
    cameras, T_body_cam = (
        tuple(values[k] for k in order)
        for values in (recording.rig.cameras, recording.rig.T_body_cam)
    )
    rig = replace(recording.rig, cameras=cameras, T_body_cam=T_body_cam)
    return replace(recording, rig=rig, streams=tuple(recording.streams[k] for k in order))
