"""Events to measure the mapper with: edge points at many depths, seen by a rig moving sideways."""

from __future__ import annotations

from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory

DEPTH_RANGE_M = (0.45, 4.0)
WINDOW_US = 500_000
_SPEED_M_S, _BASELINE_M, _NOISE = 0.2, 0.12, 0.1
_EDGE_DEPTHS_M = (0.6, 0.9, 1.4, 2.0, 3.0)


class MovingEdges:
    """A recording in memory, the same every time; a tenth of its events are uniform noise.

    Args:
        size_px: (width, height) of the cameras; the field of view is the same for every size.
        events: events per camera and window.
        cameras: how many cameras, side by side.
        windows: how many windows of half a second.
    """

    name, depth_range_m = "moving-edges", DEPTH_RANGE_M

    def __init__(
        self, size_px: tuple[int, int], events: int, *, cameras: int = 2, windows: int = 1
    ) -> None:
        width, height = size_px
        f = 0.82 * width
        camera = Camera(width, height, f, f, (width - 1) / 2, (height - 1) / 2)
        poses = []
        for k in range(cameras):
            T_body_cam = np.eye(4)
            T_body_cam[0, 3] = _BASELINE_M * k
            poses.append(T_body_cam)
        self.rig = Rig("edges", (camera,) * cameras, tuple(poses))
        self.windows, self._events = windows, events

    @cached_property
    def trajectory(self) -> Trajectory:
        """Constant speed along x, through the origin in the middle of the first window."""
        t_us = np.arange(0, self.windows * WINDOW_US + 1, WINDOW_US // 5)
        position_m = np.zeros((len(t_us), 3))
        position_m[:, 0] = _SPEED_M_S * 1e-6 * (t_us - WINDOW_US / 2)
        return Trajectory(t_us, position_m, np.tile([0.0, 0.0, 0.0, 1.0], (len(t_us), 1)))

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """Times of the first and the last event, µs."""
        t_us = self._streams[camera].t_us
        return int(t_us[0]), int(t_us[-1])

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of one camera in [t0_us, t1_us)."""
        return self._streams[camera].between(t0_us, t1_us)

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """There are no frames."""
        return None

    def write(self, path: Path) -> None:
        """Writes the recording as a sequence folder."""
        # Only now: it needs HDF5, which measuring from memory does not.
        from eventsweep.emvs.data.writer import SequenceWriter

        rig, trajectory, span_m = self.rig, self.trajectory, self.depth_range_m
        with SequenceWriter(
            path, name=self.name, rig=rig, trajectory=trajectory, config={}, depth_range_m=span_m
        ) as writer:
            for window, camera in product(range(self.windows), range(len(rig))):
                writer.append_events(camera, self._window(camera, window))

    @cached_property
    def _streams(self) -> tuple[Events, ...]:
        return tuple(
            Events.concat([self._window(k, w) for w in range(self.windows)])
            for k in range(len(self.rig))
        )

    def _window(self, camera: int, window: int) -> Events:
        """Events of one window; its points are the same for every camera."""
        its = self.rig.cameras[camera]
        size = np.array([its.width_px, its.height_px])
        rng = np.random.default_rng(window)
        points = its.width_px * its.height_px // 20
        z_m = rng.choice(_EDGE_DEPTHS_M, points) + 0.2 * rng.random(points)
        uv_px = rng.uniform(0, 1, (points, 2)) * size
        rng = np.random.default_rng((window, camera))
        t_us = np.sort(rng.integers(0, WINDOW_US, self._events))
        t_us[[0, -1]] = 0, WINDOW_US - 1
        which = rng.integers(0, points, self._events)
        moved_m = _SPEED_M_S * 1e-6 * (t_us - WINDOW_US / 2) + _BASELINE_M * camera
        uv = uv_px[which]
        uv[:, 0] -= its.fx_px * moved_m / z_m[which]
        random = (rng.random(len(uv)) < _NOISE) | ~((uv >= 0) & (uv <= size - 1)).all(axis=1)
        uv[random] = rng.uniform(0, 1, (int(random.sum()), 2)) * (size - 1)
        x, y = np.rint(uv).astype(np.uint16).T
        p = rng.integers(0, 2, len(x)).astype(np.uint8)
        return Events(x.copy(), y.copy(), t_us + window * WINDOW_US, p)
