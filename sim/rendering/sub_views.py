"""A lens's field in sub-views: pinhole pictures, each as fine as its part of the lens needs.

A graphics library draws straight lines, and a pinhole picture of a whole lens is stretched at its
rim and too fine everywhere else. So the sensor is cut into cells, and each has a pinhole view of
its own from the same optical centre: turned towards the middle of its cell, as a fisheye's rim
needs it, or straight ahead, whatever costs less. All lie side by side in one buffer, and a table
says where each sensor pixel is in it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry.camera import Camera

# Samples beyond the outermost position that bilinear interpolation and one-sided slopes touch.
_MARGIN = 3
# What a view costs besides its samples, in samples: all vertices pass the pipeline once more. Of
# `mvsec-flying` 4 ms beside 20 ns per sample, with software rendering; of `dsec-street` 11 and 45.
_VIEW_COST = 200_000
# Cells along the longer side, at most, and pixels along it that are looked at to choose.
_MOST_CELLS, _LOOKS = 8, 96

Array = NDArray[np.float64]


class SubView(NamedTuple):
    """One pinhole picture.

    Attributes:
        camera: its pixels are the samples.
        corner: column and row of its first sample in the buffer, whose bottom row comes first.
        R_cam_view: (3, 3) turn from its axes to those of the lens; None where they are the same.
    """

    camera: Camera
    corner: tuple[int, int] = (0, 0)
    R_cam_view: Array | None = None


@dataclass(frozen=True, eq=False)
class LensMap:
    """Where the pixels of a sensor lie in its sub-views.

    A position in a pixel, (du, dv) from its centre, has its place at `position + step @ (du, dv)`,
    and there z-depth in the lens's axes is z-depth in the sub-view's times
    `ratio[..., 0] + ratio[..., 1:] @ (du, dv)`, exactly.

    Attributes:
        views: the sub-views.
        shape: rows and columns of the buffer that holds them all.
        position: (H, W, 2) float32 column and row of each pixel's centre in the buffer, whose
            bottom row comes first, as graphics libraries return it.
        step: (H, W, 2, 2) float32, by how much the position changes ([..., :, 0] along the
            sensor's columns, [..., :, 1] along its rows) per sensor pixel.
        ratio: (H, W, 3) float32, see above.
    """

    views: tuple[SubView, ...]
    shape: tuple[int, int]
    position: NDArray[np.float32]
    step: NDArray[np.float32]
    ratio: NDArray[np.float32]

    @property
    def samples(self) -> int:
        """How many are drawn."""
        return sum(view.camera.width_px * view.camera.height_px for view in self.views)

    @cached_property
    def ratio_range(self) -> tuple[float, float]:
        """The least and the greatest ratio: z-depth in the lens's axes over that in a view's."""
        reach = 0.5 * np.abs(self.ratio[..., 1:]).sum(axis=-1)
        return float((self.ratio[..., 0] - reach).min()), float((self.ratio[..., 0] + reach).max())


class _Aimed(NamedTuple):
    """A view of a cell of the sensor.

    Attributes:
        size: width and height, whole numbers of samples, however many.
        focal: samples per bearing.
        centre: (2,) column and row of its axis.
        R_cam_view: (3, 3).
        place: (h, w, 2) where the cell's pixels are seen in it.
        step: (h, w, 2, 2) change of `place` by column and by row of the sensor.
        ratio: (h, w, 3) of `LensMap`.
    """

    size: Array
    focal: float
    centre: Array
    R_cam_view: Array
    place: Array
    step: Array
    ratio: Array

    @property
    def camera(self) -> Camera:
        """The pinhole camera."""
        width, height = (int(n) for n in self.size)
        column, row = (float(place) for place in self.centre)
        return Camera(width, height, self.focal, self.focal, column, row)


def sub_views(rays: Array, change: Array, supersample: int) -> LensMap:
    """The sub-views of a sensor with S x S samples per pixel, and every pixel in them.

    No pixel's area spans fewer.

    Args:
        rays: (H, W, 3) unit vector of each pixel's centre; NaN for pixels that see nothing.
        change: (H, W, 3, 2) its change by column and by row.
        supersample: S.
    """
    height, width = rays.shape[:2]
    position, step = np.full((height, width, 2), np.nan), np.full((height, width, 2, 2), np.nan)
    ratio = np.full((height, width, 3), np.nan)
    views: list[SubView] = []
    bottom = most = 0
    rows, columns, turned = cells_of(rays, change, supersample)
    for row in _cut(height, width, rows, columns):
        left = top = 0
        for cell in row:
            if np.isnan(rays[cell]).all():
                continue
            aimed = _aimed(rays[cell], change[cell], supersample, turned)
            camera = aimed.camera
            views.append(SubView(camera, (left, bottom), aimed.R_cam_view))
            # In the buffer the bottom row comes first.
            upside_down = np.array([1.0, -1.0])
            first = left, bottom + camera.height_px - 1
            position[cell] = first + upside_down * aimed.place
            step[cell] = upside_down[:, None] * aimed.step
            ratio[cell] = aimed.ratio
            left, top = left + camera.width_px, max(top, camera.height_px)
        bottom, most = bottom + top, max(most, left)
    tables = (table.astype(np.float32) for table in (position, step, ratio))
    return LensMap(tuple(views), (bottom, most), *tables)


def cells_of(rays: Array, change: Array, supersample: int) -> tuple[int, int, bool]:
    """Into how many rows and columns to cut a sensor, and whether to turn views, at least cost."""
    chosen, least = (1, 1, False), np.inf
    height, width = rays.shape[:2]
    longer = max(height, width)
    every = max(1, longer // _LOOKS)
    seen = rays[::every, ::every], change[::every, ::every]
    for most, turned in itertools.product(range(1, _MOST_CELLS + 1), (False, True)):
        rows, columns = (max(1, round(most * side / longer)) for side in (height, width))
        samples = 0.0
        for cell in itertools.chain(*_cut(len(seen[0]), len(seen[0][0]), rows, columns)):
            part, moved = seen[0][cell], seen[1][cell]
            if samples < least and not np.isnan(part).all():
                view = _aimed(part, moved, supersample, turned, every)
                samples += _VIEW_COST + float(view.size.prod())
        if samples < least:
            chosen, least = (rows, columns, turned), samples
    return chosen


def _cut(height: int, width: int, rows: int, columns: int) -> Iterator[list[tuple[slice, slice]]]:
    """The cells of a sensor, row by row."""
    across, down = (
        np.linspace(0, size, min(number, size) + 1).astype(int).tolist()
        for size, number in ((width, columns), (height, rows))
    )
    for row in itertools.pairwise(down):
        yield [(slice(*row), slice(*column)) for column in itertools.pairwise(across)]


def _aimed(rays: Array, change: Array, supersample: int, turned: bool, every: int = 1) -> _Aimed:
    """A view of a cell, of which each `every`-th pixel and row is given."""
    R_cam_view, seen, moved = np.eye(3), rays, change
    if turned:
        R_cam_view = _turn_to(np.nanmean(rays, axis=(0, 1)))
        seen, moved = rays @ R_cam_view, np.einsum("ji,...jk->...ik", R_cam_view, change)
    ahead = seen[..., 2:]
    at = seen[..., :2] / ahead
    # Quotient rule: [..., i, k] is the change of component i of a ray by column or row k.
    slope = (moved[..., :2, :] - at[..., None] * moved[..., 2:, :]) / ahead[..., None]
    area = np.abs(slope[..., 0, 0] * slope[..., 1, 1] - slope[..., 0, 1] * slope[..., 1, 0])
    focal = supersample / float(np.sqrt(np.nanmin(area)))
    reach = 0.5 * every * np.abs(slope).sum(axis=-1)
    low = focal * np.nanmin(at - reach, axis=(0, 1))
    high = focal * np.nanmax(at + reach, axis=(0, 1))
    size, centre = np.ceil(high - low) + 2 * _MARGIN, _MARGIN - low
    # z of the ray that is (place, 1) in the view, in the lens's axes.
    here = at @ R_cam_view[2, :2] + R_cam_view[2, 2]
    along = np.einsum("i,...ik->...k", R_cam_view[2, :2], slope)
    ratio = np.concatenate([here[..., None], along], axis=-1)
    return _Aimed(size, focal, centre, R_cam_view, focal * at + centre, focal * slope, ratio)


def _turn_to(direction: Array) -> Array:
    """The (3, 3) least turn that brings the z axis to a direction (3,) before the camera."""
    x, y, z = direction / np.linalg.norm(direction)
    c = 1 / (1 + z)
    return np.array([[1 - c * x * x, -c * x * y, x], [-c * x * y, 1 - c * y * y, y], [-x, -y, z]])
