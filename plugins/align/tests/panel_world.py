"""A wall, and a panel before it, seen by cameras with lenses: light, depth and events by formula.

Nothing here comes from the product but the lenses: rays meet two planes, light is a smooth pattern
on them, and a pixel's events are the crossings of its log intensity between fine steps of time.
"""

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.image_stores import FrameCamera, Photo
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory

WALL_M, PANEL_M = 2.4, 1.1
PANEL = (-0.35, 0.25, -0.22, 0.2)  # left, right, top, bottom, m
EYE = Camera(160, 120, 130.0, 129.0, 81.0, 58.5, "radtan", (-0.12, 0.04, 1e-3, -5e-4))
GREY = Camera(220, 170, 190.0, 191.5, 108.0, 86.5, "kb4", (-0.05, 0.01, -0.01, 0.003))
STEP_US = 500
EXPOSURE_US = 4000


def at(x, y, z, turn_deg=(0, 0, 0)):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    T[:3, 3] = x, y, z
    return T


RIG = Rig("panel", (EYE,), (at(0, 0, 0),), ("eye",))
T_BODY_GREY = at(0.07, -0.05, 0.02, (-2.0, 1.0, 1.5))


def pattern(x, y, phase):
    """Smooth-edged checks of several sizes: 0.1 to 0.9."""
    one = np.sin(17 * x + 3 * y + phase) * np.sin(15 * y - 2 * x + 2 * phase)
    two = np.sin(5 * x - 7 * y + phase)
    return 0.5 + 0.4 * np.tanh(4 * one + 1.5 * two)


@cache
def bearings(camera):
    """(H, W, 2) of every pixel, once for all times."""
    return camera.bearing_table()


def hits(camera, T_world_cam, uv_px=None):
    """Depth z in the camera, light, and whether it is the panel, of every pixel's ray."""
    table = bearings(camera) if uv_px is None else camera.unproject(uv_px)
    rays = np.concatenate([table, np.ones((*table.shape[:-1], 1))], -1) @ T_world_cam[:3, :3].T
    eye = T_world_cam[:3, 3]
    found = []
    for z_m, phase in ((PANEL_M, 1.0), (WALL_M, 0.0)):
        depth = (z_m - eye[2]) / rays[..., 2]
        x, y = (eye[k] + depth * rays[..., k] for k in (0, 1))
        found.append((depth, pattern(x, y, phase), x, y))
    (near, light, x, y), (far, behind, _, _) = found
    on = (x > PANEL[0]) & (x < PANEL[1]) & (y > PANEL[2]) & (y < PANEL[3])
    return np.where(on, near, far), np.where(on, light, behind), on


def hidden(points_m, T_world_cam):
    """Whether the panel is between points (..., 3) behind it and a camera."""
    eye = T_world_cam[:3, 3]
    share = (PANEL_M - eye[2]) / (points_m[..., 2] - eye[2])
    x, y = (eye[k] + share * (points_m[..., k] - eye[k]) for k in (0, 1))
    on = (x > PANEL[0]) & (x < PANEL[1]) & (y > PANEL[2]) & (y < PANEL[3])
    return on & (share < 1 - 1e-6)


def motion(seed=0, duration_us=260_000, rate=1.0):
    """A head's smooth motion, with speeds that vary."""
    rng = np.random.default_rng(seed)
    t_us = np.arange(0, duration_us + 1, 1000)
    t_s = t_us[:, None] * 1e-6
    phase, hz = rng.uniform(0, 2 * np.pi, (2, 6)), rng.uniform(1.5, 4.0, 6)
    size = np.array([0.06, 0.05, 0.03, 1.5, 1.5, 1.0]) * rate
    swing = size * (np.sin(2 * np.pi * hz * t_s + phase[0]) - np.sin(phase[0]))
    turn = Rotation.from_euler("xyz", swing[:, 3:], degrees=True)
    return Trajectory(t_us, swing[:, :3], turn.as_quat())


@dataclass
class Taken:
    """Pictures by formula, one at a time."""

    camera: Camera
    T_body_cam: np.ndarray
    trajectory: Trajectory
    t_us: np.ndarray
    late_us: int = 0  # what the stamps lack

    def photo(self, index):
        true_us = int(self.t_us[index]) + self.late_us
        times = true_us + np.linspace(-EXPOSURE_US / 2, EXPOSURE_US / 2, 7)
        seen = [
            hits(self.camera, T @ self.T_body_cam)[1] for T in self.trajectory.at(times)
        ]  # fmt: skip
        image = np.rint(255 * np.mean(seen, axis=0)).astype(np.uint8)
        half = EXPOSURE_US // 2
        return Photo(int(self.t_us[index]) - half, int(self.t_us[index]) + half, 1.0, image)


@dataclass
class PanelRecording:
    """A `Recording` with truth, and a frame camera whose stated calibration may be wrong."""

    seed: int = 0
    late_us: int = 0
    turn_rad: tuple = (0.0, 0.0, 0.0)
    threshold: float = 0.2
    cutoff_hz: float = np.inf  # of the photoreceptors at a light of 1
    shift_px: tuple = (0.0, 0.0)
    name: str = "panel"
    rig: Rig = RIG
    depth_range_m: tuple = (0.8, 3.0)
    trajectory: Trajectory = field(default=None)

    def __post_init__(self):
        self.trajectory = self.trajectory or motion(self.seed)
        frames_us = np.arange(50_000, 210_001, 32_000)
        taken = Taken(GREY, T_BODY_GREY, self.trajectory, frames_us - self.late_us, self.late_us)
        stated = T_BODY_GREY.copy()
        turn = Rotation.from_rotvec(self.turn_rad).as_matrix()
        stated[:3, :3] = stated[:3, :3] @ turn.T
        right_px, down_px = self.shift_px
        lens = replace(GREY, cx_px=GREY.cx_px - right_px, cy_px=GREY.cy_px - down_px)
        self.frame_cameras = (FrameCamera("grey", lens, stated, taken),)
        self._events = None

    def event_span_us(self, camera):
        return self.trajectory.span_us

    def events(self, camera, t0_us, t1_us):
        if self._events is None:
            self._events = crossings(self.trajectory, self.threshold, self.cutoff_hz)
        a, b = np.searchsorted(self._events.t_us, (t0_us, t1_us))
        return Events(*(column[a:b] for column in self._events.columns))

    def truth_times_us(self, camera):
        return np.arange(0, 260_001, 20_000)

    def truth_depth_m(self, camera, t_us):
        return hits(EYE, self.trajectory.at(t_us))[0].astype(np.float32)


def crossings(trajectory, threshold, cutoff_hz):
    """Events of the eye: crossings of log intensity, linear between steps of 0.5 ms.

    A photoreceptor follows by a pole whose cut-off is proportional to light, as in v2e.
    """
    first_us, last_us = trajectory.span_us
    level, parts, before = None, [], None
    for t_us in range(first_us, last_us + 1, STEP_US):
        light = hits(EYE, trajectory.at(t_us))[1]
        now = np.log(light + 0.02)
        if before is not None:
            pace = 2 * np.pi * cutoff_hz * (light + 20 / 255) / (1 + 20 / 255)
            now = before + (now - before) * -np.expm1(-1e-6 * STEP_US * pace)
        if level is None:
            level = now + np.random.default_rng(0).uniform(-0.5, 0.5, now.shape) * threshold
        else:
            parts.append(step(level, before, now, t_us - STEP_US, threshold))
        before = now
    x, y, t_us, p = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(t_us, kind="stable")
    kinds = np.uint16, np.uint16, np.int64, np.uint8
    return Events(*(c[order].astype(k) for c, k in zip((x, y, t_us, p), kinds, strict=True)))


def step(level, before, now, t0_us, threshold):
    count = np.trunc((now - level) / threshold).astype(int)
    y, x = np.nonzero(count)
    n = np.abs(count[y, x])
    sign = np.sign(count[y, x])
    rows = np.repeat(np.arange(len(x)), n)
    k = np.arange(len(rows)) - np.repeat(np.cumsum(n) - n, n) + 1
    reached = level[y, x][rows] + sign[rows] * k * threshold
    change = (now - before)[y, x][rows]
    share = np.clip((reached - before[y, x][rows]) / np.where(change == 0, 1, change), 0, 1)
    level[y, x] += sign * n * threshold
    return x[rows], y[rows], np.rint(t0_us + share * STEP_US), sign[rows] > 0
