"""Bodies that move by themselves: where their geoms are, and how far their pixels move."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry import se3
from eventsweep.sim.rendering.base import Pose, Renderer, moving_ids
from eventsweep.sim.rendering.lens import border_of, widened

# Poses are asked for again within few steps, by every camera and both ways.
_RECENT = 64


class BodyPixels(NamedTuple):
    """The pixels of one camera that show bodies which move by themselves.

    Attributes:
        pixels_px: (N, 2) column and row; those of a fine frame's border lie beyond the sensor.
        points_m: (N, 3) their surface points in the camera frame, m.
        geoms: (N,) geom ids.
    """

    pixels_px: NDArray[np.int64]
    points_m: NDArray[np.float64]
    geoms: NDArray[np.int32]


class MovingBodies:
    """The geoms that a renderer moves; exact, because their poses are a function of time."""

    def __init__(self, renderer: Renderer, *, border_px: int | None = None) -> None:
        self._renderer, self.moves = renderer, moving_ids(renderer)
        self._border = border_px is not None
        self._drawn = widened(renderer.rig, border_px or 0)
        self._recent: dict[int, Pose] = {}

    def poses(self, t_us: int) -> Pose:
        """(G, 4, 4) `T_world_geom` of all geoms at a time, µs."""
        if t_us not in self._recent:
            if len(self._recent) >= _RECENT:
                self._recent.clear()
            self._recent[t_us] = self._renderer.T_world_geoms(t_us * 1e-6)
        return self._recent[t_us]

    def moved(self, now_us: int, later_us: int) -> Pose:
        """(G, 4, 4) how each geom moves in the world: `p_world_later = T @ p_world_now`."""
        return self.poses(later_us) @ se3.inverse(self.poses(now_us))

    def seen(self, T_world_body: Pose) -> tuple[BodyPixels, ...]:
        """Per camera, the pixels whose centres show a moving body from `T_world_body` (4, 4).

        Those of fine frames' borders are among them where there are such. `renderer.at` must have
        been called.
        """
        return tuple(self._seen(k, T_world_body) for k in range(len(self._renderer.rig)))

    def _seen(self, k: int, T_world_body: Pose) -> BodyPixels:
        geoms = self._renderer.segmentation(k, T_world_body, border=self._border)
        # At the centre: a frame's nearest depth is off by too much where a face is seen edge on.
        depth_m = self._renderer.depth(k, T_world_body, border=self._border).astype(np.float64)
        # A direction without a ray has no bearing, and one without a surface no depth.
        known = np.isfinite(depth_m) & np.isfinite(self._bearings[k][..., 0])
        rows, columns = np.nonzero(self.moves[geoms] & known)
        rays = np.column_stack([self._bearings[k][rows, columns], np.ones(len(rows))])
        points_m = rays * depth_m[rows, columns, None]
        border = border_of(self._renderer.rig.cameras[k], self._drawn.cameras[k])
        pixels_px = np.stack([columns, rows], -1) - border
        return BodyPixels(pixels_px, points_m, geoms[rows, columns])

    @cached_property
    def _bearings(self) -> list[NDArray[np.float64]]:
        return [camera.bearing_table() for camera in self._drawn.cameras]

    def moved_px(
        self,
        seen: Sequence[BodyPixels],
        span_us: tuple[int, int],
        T_world_body: Pose,
        T_world_body_then: Pose,
    ) -> float:
        """The furthest that a moving body's pixel goes, px, by its own motion and the head's.

        The pixels were seen, per camera, at `span_us[0]` from the first pose, and are looked for at
        `span_us[1]` from the second. The result is inf if a point is not in front of its camera
        then.
        """
        rig, moved, largest = self._renderer.rig, self.moved(*span_us), 0.0
        for camera, T_body_cam, pixels in zip(rig.cameras, rig.T_body_cam, seen, strict=True):
            if len(pixels.geoms) == 0:
                continue
            T_then_now = (
                se3.inverse(T_world_body_then @ T_body_cam) @ moved @ T_world_body @ T_body_cam
            )[pixels.geoms]
            there = camera.project(se3.transform_each(T_then_now, pixels.points_m))
            way_px = np.linalg.norm(there - pixels.pixels_px, axis=1)
            largest = max(largest, float(np.nan_to_num(way_px, nan=np.inf).max()))
        return largest
