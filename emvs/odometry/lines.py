"""Line fields: near every place of an image the line that points around it lie on.

The line is a moving least squares fit (Levin, *The approximation power of moving least-squares*,
Mathematics of Computation 1998): mean and covariance of the points around, weighted by a Gaussian.
Its normal is the covariance's minor axis. All fits share two blurs per moment, as in an image, and
each is computed only where it is looked up.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.odometry.lines_kernels import add_inverse_depth, add_moments

Float64s = NDArray[np.float64]
_SIGMA_CELLS, _TAPS = 1.2, 7
_LEAST = 0.15  # of a Gaussian's middle: about half a point per pixel of line
_DEPTH_CELL_PX, _DEPTH_BOX = 4.0, 7
_MOMENTS = 7  # 1, a, b, aa, ab, bb, rho


class LineField:
    """Lines of (u, v, rho) points at one scale; made again for every set of points.

    Attributes:
        cell_px: size of its cells, which is its scale.
        least: mass below which there is no line.
        moments: (h, w, 7) float32 blurred moments, see `lines_kernels.line_at`.
    """

    def __init__(self, width_px: int, height_px: int, level: int) -> None:
        self.cell_px = float(1 << level)
        self.least = _LEAST * self.cell_px
        # What is looked up together lies together: a line costs one or two cache lines.
        shape = -(-height_px >> level) + 1, -(-width_px >> level) + 1, _MOMENTS
        self._sums = np.zeros(shape, np.float32)
        self.moments = np.zeros(shape, np.float32)

    def fill(self, points: Float64s, count: int) -> None:
        """Takes the first `count` rows of (N, 3) points instead of those before."""
        self._sums[:] = 0
        add_moments(points, count, self.cell_px, self._sums)
        size, border = (_TAPS, _TAPS), cv2.BORDER_CONSTANT
        cv2.GaussianBlur(self._sums, size, _SIGMA_CELLS, self.moments, borderType=border)


class DepthField:
    """Inverse depth around every place of an image: the mean of the points near it.

    Attributes:
        cell_px: size of its cells.
        rho: (h, w) float64, 1/m; above 0 everywhere, far from all points their mean.
    """

    def __init__(self, width_px: int, height_px: int) -> None:
        self.cell_px = _DEPTH_CELL_PX
        shape = int(height_px / self.cell_px) + 2, int(width_px / self.cell_px) + 2
        self._total, self._number = np.zeros(shape), np.zeros(shape)
        self.rho = np.ones(shape)

    def fill(self, points: Float64s, count: int) -> None:
        """Takes the first `count` rows (u, v, rho), at least one, instead of those before."""
        self._total[:], self._number[:] = 0, 0
        add_inverse_depth(points, count, self.cell_px, self._total, self._number)
        mean, box = float(points[:count, 2].mean()), (_DEPTH_BOX, _DEPTH_BOX)
        total, number = (
            cv2.blur(sums, box, borderType=cv2.BORDER_CONSTANT)
            for sums in (self._total, self._number)
        )
        np.divide(total + 1e-4 * mean, number + 1e-4, out=self.rho)
