"""What the tracker sees of a camera: events in its undistorted image, and the map in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.plugins.track.odometry.registration.events_kernels import draw
from eventsweep.plugins.track.odometry.registration.lines import DepthFields, LineFields
from eventsweep.plugins.track.odometry.registration.lines_kernels import point_normals, project

Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class View:
    """One camera of the rig as an undistorted pinhole of the same size.

    Attributes:
        size: (2,) float64 width and height, px.
        intrinsics: (4,) float64 fx, fy, cx, cy, px.
        table: (H, W, 2) float32 undistorted pixel of every pixel, -1 where it is out of the image.
        T_body_cam: (4, 4), and its inverse.
        T_cam_body: (4, 4).
        adjoint: (6, 6), the camera's twist from the body's.
    """

    size: Matrix
    intrinsics: Matrix
    table: NDArray[np.float32]
    T_body_cam: Matrix
    T_cam_body: Matrix
    adjoint: Matrix

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
        T_cam_body = se3.inverse(T_body_cam)
        return cls(size, intrinsics, table, T_body_cam, T_cam_body, se3.adjoint(T_cam_body))

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return int(self.size[0]), int(self.size[1])


class DrawnMap:
    """The map's points as all views see them at one pose: lines per level, depth around.

    Attributes:
        lines, depth: what was drawn.
        counts: points that each view sees.
        rho: the largest mean inverse depth of a view that sees any, 1/m.
    """

    def __init__(self, views: Sequence[View], levels: int) -> None:
        sizes_px = [view.size_px for view in views]
        self._views, self.counts, self.rho = tuple(views), [0] * len(views), 1.0
        self.lines, self.depth = LineFields(sizes_px, levels), DepthFields(sizes_px)

    def draw(self, points_world: Matrix, T_body_world: Matrix, levels: int) -> None:
        """Draws (N, 3) points, seen from a body pose, at the finest `levels`."""
        self.lines.begin()
        for k, view in enumerate(self._views):
            seen = np.empty((len(points_world), 3))
            T_cam_world = view.T_cam_body @ T_body_world
            count = project(points_world, T_cam_world, view.intrinsics, view.size, seen)
            self.counts[k] = count
            if count:
                self.depth.fill(k, seen, count)
                self.lines.fill(k, seen, count, levels)
        drawn = [k for k, count in enumerate(self.counts) if count]
        self.rho = max((float(self.depth.image(k).mean()) for k in drawn), default=1.0)

    def normals(self, points_world: Matrix, T_body_world: Matrix) -> Matrix:
        """(C, N, 2) normals of the lines that (N, 3) points lie on where the map is drawn, or 0."""
        found = np.zeros((len(self._views), len(points_world), 2))
        for k, view in enumerate(self._views):
            T_cam_world = view.T_cam_body @ T_body_world
            lines = self.lines.places[k, 0], self.lines.drawing, self.lines.field
            point_normals(points_world, T_cam_world, view.intrinsics, *lines, found[k])
        return found


class DrawnEvents:
    """A batch of events in all views: some as they are, and lines of all, carried to one time.

    Attributes:
        lines: what was drawn.
        events: (C, most, 8) rows of `event_normals`.
        counts: (C,) int64, how many of them count; -1 where a view takes no part.
    """

    def __init__(self, views: Sequence[View], levels: int, most: int) -> None:
        self._views = tuple(views)
        self.lines = LineFields([view.size_px for view in views], levels)
        self.events, self.counts = np.zeros((len(views), most, 8)), np.full(len(views), -1)

    def draw(
        self, batches: Sequence[Events], t_mid_us: int, drawn: DrawnMap, twist: Matrix, levels: int
    ) -> None:
        """Draws events at the depths of the map, at the finest `levels`; `twist` is the body's."""
        self.lines.begin()
        for k, view in enumerate(self._views):
            batch = batches[k]
            self.counts[k] = -1
            if not drawn.counts[k] or not len(batch):
                continue
            lines, (placed, carried) = self.lines, np.empty((2, len(batch), 3))
            self.counts[k] = draw(
                batch.x, batch.y, batch.t_us, t_mid_us, view.table, drawn.depth.image(k),
                float(drawn.depth.places[k, 3]), view.adjoint @ twist, view.intrinsics, view.size,
                lines.places[k, :levels], lines.drawing, lines.field, placed, carried,
                self.events[k],
            )  # fmt: skip
