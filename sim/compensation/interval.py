"""The way from one fine frame to the next: how everything in view moves, and what is seen on it.

Light is carried along the image motion, which is known exactly: each surface has its depth and its
motion. At time s, from 0 to 1, a pixel sees (1 - s) A(a(s)) + s B(b(s)): the light of the first
frame where the surface lay there, and that of the second where it will lie. At both ends that is
the frame's own pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import TERMS, Camera
from eventsweep.sim.compensation.fine_frame import FineFrame, Image
from eventsweep.sim.compensation.layer_kernels import (
    Layered,
    fill_layered_depths,
    fill_layered_picture,
)
from eventsweep.sim.compensation.layer_search_kernels import find_layers
from eventsweep.sim.compensation.path_kernels import (
    Geometry,
    View,
    fill_picture,
    fill_places,
    longest_way,
)
from eventsweep.sim.rendering.lens import known_bearings, widened_camera
from eventsweep.sim.rendering.moving_bodies import BodyPixels

Pose = NDArray[np.float64]
Moved = Callable[[int, int], Pose]
"""(G, 4, 4) how each geom moves in the world from one time to another, µs."""
_MODELS = {name: number for number, name in enumerate(TERMS)}
_TERMS = 5


@dataclass(frozen=True)
class Interval:
    """How the view of one camera changes between two frames.

    Attributes:
        before_us, after_us: times of the two frames, µs.
        ways: (K, 4, 4, 4) transforms of camera coordinates, of what stands still first, then of
            bodies that move by themselves; see `sim.compensation.path_kernels.TO_FIRST_MIDDLE`.
        body_before, body_after: (H + 2 B, W + 2 B) whose surface each pixel of each frame shows,
            with its border, index of `ways`.
    """

    before_us: int
    after_us: int
    ways: NDArray[np.float64]
    body_before: NDArray[np.uint16]
    body_after: NDArray[np.uint16]

    def share(self, t_us: NDArray[np.int64]) -> NDArray[np.float64]:
        """Times as shares of the interval, 0 to 1; outside of it the nearer end."""
        span_us = self.after_us - self.before_us
        share: NDArray[np.float64] = np.clip((t_us - self.before_us) / span_us, 0.0, 1.0)
        return share


class Lens(NamedTuple):
    """A camera as compiled code takes it: (H, W, 2) bearings, and (10,) what projects them."""

    bearing: NDArray[np.float32]
    terms: NDArray[np.float64]


@lru_cache(maxsize=16)
def lens_of(camera: Camera) -> Lens:
    """The camera's tables."""
    padded = (*camera.distortion, *(0.0,) * (_TERMS - len(camera.distortion)))
    straight = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    terms = np.array([*straight, _MODELS[camera.model], *padded])
    return Lens(known_bearings(camera).astype(np.float32), terms)


def interval_between(
    span_us: tuple[int, int],
    T_world_cam: tuple[Pose, Pose, Pose],
    shape: tuple[int, int],
    bodies: tuple[BodyPixels, BodyPixels] | None = None,
    moved: Moved | None = None,
    border_px: int = 0,
) -> Interval:
    """Describes how one camera's view changes between two times, µs.

    `shape` is that of fine frames' pixels with their border, (H + 2 B, W + 2 B).

    The (4, 4) camera poses are those at the first frame, half-way in time and at the second. Where
    bodies move by themselves, `bodies` are their pixels in both frames, `moved` how their geoms go.
    """
    ways = [_ways(*T_world_cam, *(np.eye(4),) * 4)]
    shown = np.zeros((2, *shape), np.uint16)
    if bodies is not None and moved is not None:
        geoms = np.unique(np.concatenate([seen.geoms for seen in bodies]))
        start, end = span_us
        middle = (start + end) // 2
        spans_us = (middle, start), (end, start), (middle, end), (start, end)
        own = [moved(*span) for span in spans_us] if len(geoms) else []
        ways += [_ways(*T_world_cam, *(of_all[geom] for of_all in own)) for geom in geoms]
        for image, seen in zip(shown, bodies, strict=True):
            columns, rows = (seen.pixels_px + border_px).T
            image[rows, columns] = np.searchsorted(geoms, seen.geoms) + 1
    return Interval(*span_us, np.array(ways), *shown)


def _ways(
    T_world_start: Pose, T_world_middle: Pose, T_world_end: Pose,
    start_middle: Pose, start_end: Pose, end_middle: Pose, end_start: Pose,
) -> NDArray[np.float64]:  # fmt: skip
    """The four transforms, of a body whose own motion in the world is given."""
    to_start, to_end = se3.inverse(T_world_start), se3.inverse(T_world_end)
    return np.array(
        [
            to_start @ start_middle @ T_world_middle,
            to_start @ start_end @ T_world_end,
            to_end @ end_middle @ T_world_middle,
            to_end @ end_start @ T_world_start,
        ]
    )


@dataclass(frozen=True, eq=False)
class Passage:
    """Two fine frames of one camera and the interval between them."""

    camera: Camera
    before: FineFrame
    after: FineFrame
    interval: Interval

    @cached_property
    def geometry(self) -> Geometry:
        """What `path_of` needs beside the pixel."""
        (height, width), border = self.before.shape, self.before.border_px
        inner = slice(border, border + height), slice(border, border + width)
        shown = self.interval.body_before, self.interval.body_after
        bodies = (np.ascontiguousarray(body[inner]) for body in shown)
        view = View(*lens_of(self.camera), self.interval.ways)
        return Geometry(view, self.before.rho, self.after.rho, *bodies)

    @cached_property
    def layered(self) -> Layered:
        """Where one path is not enough."""
        interval, grid, border = self.interval, self.before.grid, self.before.border_px
        seen = self.before.seen(interval.body_before), self.after.seen(interval.body_after)
        wide = lens_of(widened_camera(self.camera, border)).bearing
        view = View(wide, lens_of(self.camera).terms, interval.ways)
        return Layered(find_layers(*seen, grid, border, view), *seen, grid, border)

    def times_us(self, most_px: float) -> list[int]:
        """Rising times, µs, up to the second frame's, with no pixel moving further in between."""
        way_px, _ = self._paths
        start_us, end_us = self.interval.before_us, self.interval.after_us
        number = min(max(int(np.ceil(way_px / most_px)), 1), end_us - start_us)
        return [start_us + (end_us - start_us) * k // number for k in range(1, number + 1)]

    def pictures(self, times_us: Sequence[int]) -> Iterator[Image]:
        """What the pixels see, (H, W) light, at times after the first frame, up to the second."""
        _, paths = self._paths
        last_us, last = self.interval.after_us, self.after
        return (last.pixels if t == last_us else self._picture(t, paths) for t in times_us)

    def places(
        self, x: NDArray[np.uint16], y: NDArray[np.uint16], t_us: NDArray[np.int64]
    ) -> NDArray[np.int32]:
        """(N, 4) column and row, in both frames, of what was seen at some pixels and times."""
        places = np.empty((len(x), 4), np.int32)
        fill_places(x, y, self.interval.share(t_us), self.geometry, places)
        return places

    def layered_depths(
        self,
        x: NDArray[np.uint16],
        y: NDArray[np.uint16],
        t_us: NDArray[np.int64],
        depth_m: NDArray[np.float32],
    ) -> None:
        """Puts the nearest depth into (N,) `depth_m` where pixels see several surfaces."""
        share = self.interval.share(t_us)
        fill_layered_depths(self.layered, self.geometry.lens_view, x, y, share, depth_m)

    @cached_property
    def _paths(self) -> tuple[float, NDArray[np.float32]]:
        height, width = self.before.shape
        paths = np.empty((height, 9, width), np.float32)
        return longest_way(self.geometry, paths), paths

    def _picture(self, t_us: int, paths: NDArray[np.float32]) -> Image:
        picture = np.empty(self.before.shape, np.float32)
        share = float(self.interval.share(np.array(t_us)))
        light = self.before.light, self.after.light
        fill_picture(*light, paths, self.before.grid, self.before.border_px, share, picture)
        fill_layered_picture(self.layered, self.geometry.lens_view, share, picture)
        return picture
