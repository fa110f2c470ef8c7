"""What the tracker sees of a camera: events in its undistorted image, and the map in it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.odometry.events_kernels import compensate, place
from eventsweep.emvs.odometry.lines import DepthField, LineField
from eventsweep.emvs.odometry.lines_kernels import project

Matrix = NDArray[np.float64]
Made = TypeVar("Made")


@dataclass(frozen=True, eq=False)
class View:
    """One camera of the rig as an undistorted pinhole of the same size.

    Attributes:
        size: (2,) float64 width and height, px.
        intrinsics: (4,) float64 fx, fy, cx, cy, px.
        table: (H, W, 2) float32 undistorted pixel of every pixel, -1 where it is out of the image.
        T_body_cam: (4, 4), and its inverse.
        T_cam_body: (4, 4).
    """

    size: Matrix
    intrinsics: Matrix
    table: NDArray[np.float32]
    T_body_cam: Matrix
    T_cam_body: Matrix

    @classmethod
    def of(cls, camera: Camera, T_body_cam: Matrix) -> View:
        """The view of a camera that sits so on the body."""
        focal_px, middle_px = (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px)
        size = np.array([camera.width_px, camera.height_px], np.float64)
        uv = camera.bearing_table() * focal_px + middle_px
        with np.errstate(invalid="ignore"):
            inside = ((uv >= 0) & (uv <= size - 1)).all(axis=-1, keepdims=True)
        table = np.where(inside, uv, -1).astype(np.float32)
        intrinsics = np.array([*focal_px, *middle_px])
        return cls(size, intrinsics, table, T_body_cam, se3.inverse(T_body_cam))

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return int(self.size[0]), int(self.size[1])


class DrawnMap:
    """The map's points as a view sees them at one pose: lines per level, depth around."""

    def __init__(self, view: View, levels: int) -> None:
        self._view, self.count = view, 0
        self.lines = [LineField(*view.size_px, level) for level in range(levels)]
        self.depth = DepthField(*view.size_px)

    def draw(self, points_world: Matrix, T_body_world: Matrix, levels: int) -> None:
        """Draws (N, 3) points, seen from a body pose, at the finest `levels`."""
        view, seen = self._view, np.empty((len(points_world), 3))
        T_cam_world = view.T_cam_body @ T_body_world
        self.count = project(points_world, T_cam_world, view.intrinsics, view.size, seen)
        if not self.count:
            return
        self.depth.fill(seen, self.count)
        for field in self.lines[:levels]:
            field.fill(seen, self.count)


class DrawnEvents:
    """A batch of events in a view: some as they are, and lines of all, carried to one time."""

    def __init__(self, view: View, levels: int) -> None:
        self._view, self.count = view, 0
        self.lines = [LineField(*view.size_px, level) for level in range(levels)]
        self.events = np.empty((0, 3))

    def draw(
        self, events: Events, t_mid_us: int, drawn: DrawnMap, twist: Matrix, most: int, levels: int
    ) -> None:
        """Draws events at the depths of the map, at the finest `levels`.

        `events` keeps at most `most` rows (u, v, dt).
        """
        view, n = self._view, len(events)
        self.events = np.empty((min(n, most), 3))
        columns = events.x, events.y, events.t_us
        self.count = place(*columns, t_mid_us, view.table, self.events)
        placed, carried = np.empty((n, 3)), np.empty((n, 3))
        count = place(*columns, t_mid_us, view.table, placed)
        count = compensate(
            placed, count, drawn.depth.rho, drawn.depth.cell_px, twist, view.T_cam_body,
            view.T_body_cam, view.intrinsics, view.size, carried,
        )  # fmt: skip
        for field in self.lines[:levels]:
            field.fill(carried, count)


class PerCamera:
    """Calls a function of a camera's number for all cameras, each in a thread of its own.

    Results are in the order of the cameras. Kernels hold no lock.

    Args:
        count: cameras.
        threads: most threads, the caller's own among them; 0 for one per camera.
    """

    def __init__(self, count: int, threads: int = 0) -> None:
        self._cameras = range(count)
        helpers = min(count, threads or count) - 1
        self._helpers = ThreadPoolExecutor(helpers, "camera") if helpers > 0 else None

    def __call__(self, work: Callable[[int], Made]) -> list[Made]:
        """What `work` returns for each camera; the first is done by the caller itself."""
        if self._helpers is None:
            return [work(camera) for camera in self._cameras]
        others = [self._helpers.submit(work, camera) for camera in self._cameras[1:]]
        return [work(0), *(other.result() for other in others)]
