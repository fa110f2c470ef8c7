"""The sharpness of DSIs as a function of calibration, fast enough to be maximised.

Rays of one edge meet in few voxels where calibration, clocks and poses are right. As in
`emvs.sharpness`, the measure is the mean of the largest ray maxima of the cameras' harmonic mean;
but events are read once and thinned, planes are few, and a coarse level sees large errors, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from emvs.calibrate import objective_kernels
from emvs.calibrate.parameters import Correction
from emvs.calibrate.windows import WindowEvents
from emvs.data.events import Events
from emvs.data.recording import Recording
from emvs.dsi.rays import Rays, event_rays
from emvs.geometry.camera import Camera
from emvs.geometry.rig import Rig
from emvs.geometry.trajectory import Trajectory
from emvs.reference_view import inverse_depth_planes

Floats = NDArray[np.float64]
# Of the rays of the view. Sums over all of them follow what votes at random do, too, and their
# powers the few strongest edges: both are less sure over windows.
_LARGEST_SHARE = 0.01
# How much of the range of inverse depth is added at both ends. Without it a turn that moves what
# is farthest beyond the last plane looks worse than one that moves it nearer: 0.05 to 0.1 deg.
_MARGIN = 0.2
_FARTHEST_M = 1e3


@dataclass(frozen=True)
class Level:
    """How finely the DSI is cut.

    Attributes:
        scale: pixels of the sensor per pixel of the view, along each axis.
        planes: of the DSI.
    """

    scale: int
    planes: int


FINE, MIDDLE, COARSE = Level(1, 48), Level(2, 32), Level(4, 24)


@dataclass(frozen=True)
class Told:
    """What is said about the events of a window.

    Attributes:
        rig: calibration.
        trajectory: `T_world_body`; it must cover the window's middle.
        clock_us: added to the times of each camera's events.
    """

    rig: Rig
    trajectory: Trajectory
    clock_us: tuple[int, ...]


class Objective:
    """Sharpness of several windows under a correction of the calibration.

    Args:
        recording: calibration and poses as given.
        windows: events.
        depth_range_m: nearest and farthest depth.
        level: how finely the DSI is cut.

    Attributes:
        evaluations: windows evaluated so far.
    """

    def __init__(
        self,
        recording: Recording,
        windows: Sequence[WindowEvents],
        depth_range_m: tuple[float, float],
        level: Level = FINE,
    ) -> None:
        self.recording, self.windows, self.level = recording, tuple(windows), level
        self._depth_range_m = depth_range_m
        self._rho = inverse_depth_planes(*_widened(*depth_range_m), level.planes)
        view = _view(recording.rig.cameras[0], level.scale)
        pixels = view.width_px * view.height_px
        self._grids = np.empty((len(self.windows), len(recording.rig), pixels), np.float32)
        self._best = np.empty((len(self.windows), pixels), np.float32)
        self.evaluations = 0

    def at(self, level: Level) -> Objective:
        """The same windows at another level; a coarse one needs fewer events."""
        share = self.level.scale / level.scale
        windows = [one.thinned(share) for one in self.windows]
        return Objective(self.recording, windows, self._depth_range_m, level)

    def __call__(self, correction: Correction) -> Floats:
        """(W,) sharpness of every window."""
        told = self.told(correction)
        return self.sharpness([told] * len(self.windows))

    def told(self, correction: Correction) -> Told:
        """What a correction says."""
        rig, poses = self.recording.rig, self.recording.trajectory
        clock_us = correction.clock_us(len(rig))
        return Told(correction.rig(rig), correction.trajectory(poses), clock_us)

    def sharpness(self, told: Sequence[Told]) -> Floats:
        """(W,) mean of the largest ray maxima of each window, each told otherwise."""
        best = self.ray_maxima(told)
        largest = max(1, round(_LARGEST_SHARE * best.shape[1]))
        top = np.partition(best, -largest, axis=1)[:, -largest:]
        return np.asarray(top.mean(axis=1, dtype=np.float64))

    def ray_maxima(self, told: Sequence[Told]) -> NDArray[np.float32]:
        """(W, pixels) the largest harmonic mean of votes along each ray of the views; reused."""
        self.evaluations += len(told)
        rays = [self._rays(*pair) for pair in zip(self.windows, told, strict=True)]
        columns = zip(*(one.columns for of_window in rays for one in of_window), strict=True)
        begin = np.cumsum([0] + [len(one) for of_window in rays for one in of_window])
        cameras = len(self.recording.rig)
        at = np.arange(len(rays))[:, None] * cameras + np.arange(cameras + 1)
        view = _view(self.recording.rig.cameras[0], self.level.scale)
        objective_kernels.ray_maxima(  # type: ignore[call-arg]
            *map(np.concatenate, columns), begin[at], self._rho, view.width_px, view.height_px,
            self._grids, self._best,
        )  # fmt: skip
        return self._best

    def _rays(self, window: WindowEvents, told: Told) -> list[Rays]:
        near = _around(told.trajectory, window, max(map(abs, told.clock_us), default=0))
        T_world_rv = near.at(window.t_ref_us) @ told.rig.T_body_cam[0]
        view = _view(told.rig.cameras[0], self.level.scale)
        each = zip(window.events, told.clock_us, told.rig.cameras, told.rig.T_body_cam, strict=True)
        return [
            event_rays(_on_clock(events, late_us), _tabulated(camera), T, near, T_world_rv, view)
            for events, late_us, camera, T in each
        ]


def _widened(near_m: float, far_m: float) -> tuple[float, float]:
    """A depth range with a margin at both ends."""
    more = _MARGIN * (1 / near_m - 1 / far_m)
    return 1 / (1 / near_m + more), 1 / max(1 / _FARTHEST_M, 1 / far_m - more)


def _on_clock(events: Events, late_us: int) -> Events:
    return replace(events, t_us=events.t_us + late_us) if late_us else events


def _around(trajectory: Trajectory, window: WindowEvents, more_us: int) -> Trajectory:
    """The poses of a window and one on each side: what is far away need not be carried along."""
    bounds = [window.t0_us - more_us, window.t1_us + more_us]
    first, last = np.searchsorted(trajectory.t_us, bounds)
    part = slice(max(0, int(first) - 1), int(last) + 1)
    return Trajectory(
        trajectory.t_us[part], trajectory.positions_m[part], trajectory.quats_xyzw[part]
    )


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


class _Tabulated(Camera):
    """A camera with the table of its pixels' bearings."""

    def bearing_table(self) -> Floats:
        """(H, W, 2) the table."""
        return _table(self)


@lru_cache(maxsize=16)
def _table(camera: Camera) -> Floats:
    return Camera(**vars(camera)).bearing_table()


@lru_cache(maxsize=16)
def _tabulated(camera: Camera) -> Camera:
    return _Tabulated(**vars(camera))
