"""How sharp the DSIs of windows are: the higher, the better events, calibration and poses agree.

Rays of one edge meet in few voxels where all of them are right, and spread over many where a clock,
a pose or a calibration is wrong: the number of votes stays, their maxima fall. Contrast of votes as
a measure of alignment is Gallego et al., CVPR 2018; here it is that of the fused volume, which also
shows how well the cameras agree with each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.dsi.rays import Rays, knots, rays_between
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose import sharpness_kernels

Floats = NDArray[np.float64]
# Of the rays of the view. Sums over all of them also follow random votes, and their powers the few
# strongest edges: both vary more from window to window.
_LARGEST_SHARE = 0.01
# How much of the range of inverse depth is added at both ends. Without it a turn that moves the
# farthest things beyond the last plane looks worse than one that moves them nearer (0.05 deg).
_MARGIN = 0.2


@dataclass(frozen=True)
class Level:
    """How finely the DSI is cut: sensor's pixels per pixel of the view and axis, and planes."""

    scale: int
    planes: int


@dataclass(frozen=True)
class WindowEvents:
    """A window `t0_us <= t < t1_us`, and each camera's events that vote, thinned evenly."""

    t0_us: int
    t1_us: int
    events: tuple[Events, ...]

    @property
    def t_ref_us(self) -> int:
        """The time of the reference view: the middle."""
        return (self.t0_us + self.t1_us) // 2

    def thinned(self, share: float) -> WindowEvents:
        """The window with a share of its events, evenly through the stream."""
        fewer = [events.thinned(max(1, int(share * len(events)))) for events in self.events]
        return replace(self, events=tuple(fewer))


@dataclass(frozen=True)
class Hypothesis:
    """Calibration, poses and clocks under which a window is mapped.

    Attributes:
        rig: calibration.
        trajectory: `T_world_body`; it must cover the window's middle.
        clock_us: added to the times of each camera's events; empty for none.
    """

    rig: Rig
    trajectory: Trajectory
    clock_us: tuple[int, ...] = ()


class Sharpness:
    """Sharpness of the fused DSIs of several windows at once; the windows share the threads.

    Its planes reach beyond the depth range, nearest to farthest: `calibrate.md` says why.
    """

    def __init__(self, depth_range_m: tuple[float, float], level: Level) -> None:
        self.level = level
        self._rho = _planes(*depth_range_m, level.planes)
        self._grids = np.empty((0, 0, 0), np.float32)
        self._best = np.empty((0, 0), np.float32)

    def __call__(self, windows: Sequence[WindowEvents], hypotheses: Sequence[Hypothesis]) -> Floats:
        """(W,) mean of the largest ray maxima of each window under its hypothesis, in votes.

        All hypotheses have as many cameras, and first cameras of one size.

        Raises:
            InputError: poses that do not cover the middle of a window, events off their sensor.
        """
        best = self.ray_maxima(windows, hypotheses)
        largest = max(1, round(_LARGEST_SHARE * best.shape[1]))
        top = np.partition(best, -largest, axis=1)[:, -largest:]
        return np.asarray(top.mean(axis=1, dtype=np.float64))

    def ray_maxima(
        self, windows: Sequence[WindowEvents], hypotheses: Sequence[Hypothesis]
    ) -> NDArray[np.float32]:
        """(W, pixels) the largest harmonic mean of votes along each ray of the views; reused."""
        rays = [
            camera_rays
            for window, hypothesis in zip(windows, hypotheses, strict=True)
            for camera_rays in self._rays(window, hypothesis)
        ]
        columns = zip(*(camera_rays.columns for camera_rays in rays), strict=True)
        begin = np.cumsum([0, *map(len, rays)])
        cameras = len(hypotheses[0].rig)
        at = np.arange(len(windows))[:, None] * cameras + np.arange(cameras + 1)
        view = _view(hypotheses[0].rig.cameras[0], self.level.scale)
        shape = len(windows), cameras, view.width_px * view.height_px
        if self._grids.shape != shape:
            self._grids = np.empty(shape, np.float32)
            self._best = np.empty((shape[0], shape[2]), np.float32)
        sharpness_kernels.ray_maxima(  # type: ignore[call-arg]
            *map(np.concatenate, columns), begin[at], self._rho, view.width_px, view.height_px,
            self._grids, self._best,
        )  # fmt: skip
        return self._best

    def _rays(self, window: WindowEvents, hypothesis: Hypothesis) -> list[Rays]:
        rig, clock_us = hypothesis.rig, hypothesis.clock_us or (0,) * len(hypothesis.rig)
        far_us, known = max(map(abs, clock_us)), hypothesis.trajectory
        part = around(known, window.t0_us - far_us, window.t1_us + far_us)
        near = Trajectory(known.t_us[part], known.positions_m[part], known.quats_xyzw[part])
        poses = knots(near, near.at(window.t_ref_us) @ rig.T_body_cam[0])
        view = _view(rig.cameras[0], self.level.scale)
        each = zip(window.events, clock_us, rig.cameras, rig.T_body_cam, strict=True)
        return [
            rays_between(events.shifted(late_us), camera, T, poses, view)
            for events, late_us, camera, T in each
        ]


def _planes(near_m: float, far_m: float, count: int) -> NDArray[np.float32]:
    """(count,) inverse depths, 1/m, with a margin at both ends, if need be beyond infinity.

    A wrong turn moves far things to where rays meet behind the cameras.
    """
    more = _MARGIN * (1 / near_m - 1 / far_m)
    return np.linspace(1 / near_m + more, 1 / far_m - more, count).astype(np.float32)


def around(trajectory: Trajectory, t0_us: int, t1_us: int) -> slice:
    """Which poses lie between two times, and one on each side."""
    first, last = np.searchsorted(trajectory.t_us, [t0_us, t1_us])
    return slice(max(0, int(first) - 1), int(last) + 1)


def _view(camera: Camera, scale: int) -> Camera:
    """The first camera without distortion, its pixels joined `scale` by `scale`."""
    return Camera(
        max(1, camera.width_px // scale),
        max(1, camera.height_px // scale),
        camera.fx_px / scale,
        camera.fy_px / scale,
        (camera.cx_px + 0.5) / scale - 0.5,
        (camera.cy_px + 0.5) / scale - 0.5,
    )
