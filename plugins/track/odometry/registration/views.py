"""What the tracker sees of a camera: events in its undistorted image, and the map in it, as lines.

A line is a moving least squares fit (Levin, *The approximation power of moving least-squares*,
Mathematics of Computation 1998): mean and covariance of the points around, weighted by a Gaussian.
Its normal is the covariance's minor axis. Each is computed only where it is looked up, and once: so
an image of any size costs what its points cost.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.utils.vectors_kernels import aligned
from eventsweep.plugins.track.odometry.registration.events_kernels import BLOCK, draw
from eventsweep.plugins.track.odometry.registration.lines_kernels import (
    MARGIN,
    REACH,
    SUMS,
    add_inverse_depth,
    add_points,
    empty,
    point_normals,
    project,
)

Matrix = NDArray[np.float64]
_DEPTH_CELL_PX, _DEPTH_BOX = 4, 7
_LINE = 8


class LineFields:
    """Lines of (u, v, rho) points in images at several scales; made again by every drawing.

    Attributes:
        places: (C, L, 4) int64, where each image's cells lie at each scale.
        field: the arrays, see `lines_kernels`.
    """

    def __init__(self, sizes_px: Sequence[tuple[int, int]], levels: int) -> None:
        self.places = np.empty((len(sizes_px), levels, 4), np.int64)
        cells = 0
        for k, (width_px, height_px) in enumerate(sizes_px):
            for level in range(levels):
                rows, columns = -(-height_px >> level) + 1, -(-width_px >> level) + 1
                columns += columns % 2
                before = REACH * (columns + MARGIN + 1)
                self.places[k, level] = cells + before, rows, columns, 1 << level
                cells += 2 * before + rows * (columns + MARGIN)
        lines = aligned(_LINE * (cells + 1)).reshape(cells + 1, _LINE)
        cells_of = lines.view(np.int32)[:, -1]  # beside the line: one cache line for both
        self.field = (
            aligned(SUMS * (cells + 2)), *np.zeros((2, cells // 2 + 1), np.int32),
            np.ones(cells, np.int32), lines, cells_of, aligned(8 * SUMS),
        )  # fmt: skip

    def begin(self) -> None:
        """Begins a drawing: whatever was in the fields is gone."""
        empty(self.field)

    def fill(self, image: int, points: Matrix, count: int, levels: int) -> None:
        """Adds the first `count` rows of (N, 3) points to an image, at its finest `levels`."""
        for place in self.places[image, :levels]:
            add_points(points, count, place, self.field)


class DepthFields:
    """Inverse depth around every place of images: the mean of the points near it.

    Attributes:
        places: (C, 4) int64, each image's first cell, rows, columns, and the size of a cell, px.
        rho: (N,) float64, 1/m; above 0 everywhere, far from all points their mean.
    """

    def __init__(self, sizes_px: Sequence[tuple[int, int]]) -> None:
        cell_px, self.places = _DEPTH_CELL_PX, np.empty((len(sizes_px), 4), np.int64)
        cells = 0
        for k, (width_px, height_px) in enumerate(sizes_px):
            rows, columns = height_px // cell_px + 2, width_px // cell_px + 2
            self.places[k] = cells, rows, columns, cell_px
            cells += rows * columns
        self.rho = np.ones(cells)

    def image(self, image: int) -> Matrix:
        """The (h, w) part of `rho` of an image."""
        first, rows, columns, _ = self.places[image]
        return self.rho[first : first + rows * columns].reshape(rows, columns)

    def fill(self, image: int, points: Matrix, count: int) -> None:
        """Takes the first `count` rows (u, v, rho), at least one, instead of those before."""
        rho = self.image(image)
        total, number = np.zeros_like(rho), np.zeros_like(rho)
        add_inverse_depth(points, count, float(_DEPTH_CELL_PX), total, number)
        mean, box = float(points[:count, 2].mean()), (_DEPTH_BOX, _DEPTH_BOX)
        around, near = (
            cv2.blur(sums, box, borderType=cv2.BORDER_CONSTANT) for sums in (total, number)
        )
        np.divide(around + 1e-4 * mean, near + 1e-4, out=rho)


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

    def __init__(self, camera: Camera, T_body_cam: Matrix) -> None:
        focal_px, middle_px = (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px)
        self.size = np.array([camera.width_px, camera.height_px], np.float64)
        self.intrinsics = np.array([*focal_px, *middle_px])
        uv = camera.bearing_table() * focal_px + middle_px
        with np.errstate(invalid="ignore"):
            inside = ((uv >= 0) & (uv <= self.size - 1)).all(axis=-1, keepdims=True)
        self.table: NDArray[np.float32] = np.where(inside, uv, -1).astype(np.float32)
        self.T_body_cam, self.T_cam_body = T_body_cam, se3.inverse(T_body_cam)
        self.adjoint = se3.adjoint(self.T_cam_body)

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
        normals = np.zeros((len(self._views), len(points_world), 2))
        for k, view in enumerate(self._views):
            T_cam_world = view.T_cam_body @ T_body_world
            lines = self.lines.places[k, 0], self.lines.field
            point_normals(points_world, T_cam_world, view.intrinsics, *lines, normals[k])
        return normals


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
        self._placed, self._carried = np.empty((0, 3)), np.empty((BLOCK, 3))

    def draw(
        self, batches: Sequence[Events], t_mid_us: int, drawn: DrawnMap, twist: Matrix, levels: int,
        *, judged: bool = False,
    ) -> None:  # fmt: skip
        """Draws events at the depths of the map, at the finest `levels`; `twist` is the body's.

        If `judged`, lines that drift by themselves take no part, see `lines_kernels`.
        """
        self.lines.begin()
        for k, view in enumerate(self._views):
            batch = batches[k]
            self.counts[k] = -1
            if not drawn.counts[k] or not len(batch):
                continue
            per_spread = 1 / (1e-6 * max(float(batch.t_us.std()), 1.0)) if judged else 0.0
            if len(batch) > len(self._placed):  # fresh memory costs as much as filling it
                self._placed = np.empty((len(batch), 3))
            lines = self.lines
            self.counts[k] = draw(
                batch.x, batch.y, batch.t_us, t_mid_us, view.table, drawn.depth.image(k),
                float(drawn.depth.places[k, 3]), view.adjoint @ twist, view.intrinsics, view.size,
                per_spread, lines.places[k, :levels], lines.field, self._placed,
                self._carried, self.events[k],
            )  # fmt: skip
