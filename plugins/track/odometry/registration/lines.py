"""Line fields: near every place of an image the line that points around it lie on.

The line is a moving least squares fit (Levin, *The approximation power of moving least-squares*,
Mathematics of Computation 1998): mean and covariance of the points around, weighted by a Gaussian.
Its normal is the covariance's minor axis. Each is computed only where it is looked up, and once: so
an image of any size costs what its points cost.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.utils.vectors_kernels import aligned
from eventsweep.plugins.track.odometry.registration.lines_kernels import (
    MARGIN,
    REACH,
    SUMS,
    add_inverse_depth,
    add_points,
    empty,
)

Float64s = NDArray[np.float64]
_DEPTH_CELL_PX, _DEPTH_BOX = 4, 7
_LINE = 8


class LineFields:
    """Lines of (u, v, rho) points in images at several scales; made again by every drawing.

    Attributes:
        places: (C, L, 4) int64, where each image's cells lie at each scale.
        field: the arrays, see `lines_kernels`.
        drawing: number of the last drawing.
    """

    def __init__(self, sizes_px: Sequence[tuple[int, int]], levels: int) -> None:
        self.places = np.empty((len(sizes_px), levels, 4), np.int64)
        cells = 0
        for k, (width_px, height_px) in enumerate(sizes_px):
            for level in range(levels):
                rows, columns = -(-height_px >> level) + 1, -(-width_px >> level) + 1
                before = REACH * (columns + MARGIN + 1)
                self.places[k, level] = cells + before, rows, columns, 1 << level
                cells += 2 * before + rows * (columns + MARGIN)
        lines = aligned(_LINE * cells).reshape(cells, _LINE)
        made = lines.view(np.int32)[:, -1]  # beside the line: one cache line for both
        self.field = (
            aligned(SUMS * cells), np.zeros(cells + 1, np.int32), made, lines, aligned(6 * SUMS),
        )  # fmt: skip
        self.drawing = 0

    def begin(self) -> None:
        """Begins a drawing: whatever was in the fields is gone."""
        self.drawing += 1
        empty(self.field)

    def fill(self, image: int, points: Float64s, count: int, levels: int) -> None:
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

    def image(self, image: int) -> Float64s:
        """The (h, w) part of `rho` of an image."""
        first, rows, columns, _ = self.places[image]
        return self.rho[first : first + rows * columns].reshape(rows, columns)

    def fill(self, image: int, points: Float64s, count: int) -> None:
        """Takes the first `count` rows (u, v, rho), at least one, instead of those before."""
        rho = self.image(image)
        total, number = np.zeros_like(rho), np.zeros_like(rho)
        add_inverse_depth(points, count, float(_DEPTH_CELL_PX), total, number)
        mean, box = float(points[:count, 2].mean()), (_DEPTH_BOX, _DEPTH_BOX)
        around, near = (
            cv2.blur(sums, box, borderType=cv2.BORDER_CONSTANT) for sums in (total, number)
        )
        np.divide(around + 1e-4 * mean, near + 1e-4, out=rho)
