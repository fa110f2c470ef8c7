"""Registers a batch of events with a map: Gauss-Newton over a pose and a twist, coarse to fine.

With the belief of `motion` this is the update of an iterated extended Kalman filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.odometry.motion import Motion
from eventsweep.emvs.odometry.residuals_kernels import events_to_map, map_to_events
from eventsweep.emvs.odometry.views import DrawnEvents, DrawnMap, PerCamera, View

Matrix = NDArray[np.float64]
_CAUCHY_PX, _GATE_PX = 0.7, 2.5  # at the finest level; twice as much at each coarser one
# What a squared residual of a pixel counts: events of one edge, and of batches that overlap, err
# together.
_TRUST = 0.2
_STEPS, _COARSER_STEPS = 4, 2  # of Gauss-Newton per level, associations anew in each
_ENOUGH = 2e-5  # m, rad: a smaller step changes nothing
_REDRAW_PX = 6.0  # the map is drawn anew once it has moved by so much


@dataclass(frozen=True)
class Fit:
    """How well a registration went, over all cameras, at the finest level.

    Attributes:
        events: events looked at that the map could explain: those that it is in view of.
        events_near: of those, the ones near a line of the map.
        points: map points in view.
        points_near: of those, the ones near a line of the events.
        closeness: mean weight of the residuals, 0.36 where they are as large as it happens, 1 where
            they are 0.
    """

    events: int = 0
    events_near: int = 0
    points: int = 0
    points_near: int = 0
    closeness: float = 0.0

    @classmethod
    def of(cls, counts: Matrix) -> Fit:
        """From events, those near a line and their closeness, and the same of points: (6,)."""
        near = max(counts[1] + counts[4], 1)
        events, events_near, points, points_near = (round(float(counts[k])) for k in (0, 1, 3, 4))
        closeness = float(counts[2] + counts[5]) / near
        return cls(events, events_near, points, points_near, closeness)

    @property
    def inliers(self) -> int:
        """Residuals that decided."""
        return self.events_near + self.points_near

    @property
    def events_share(self) -> float:
        """Share of events near a line of the map."""
        return self.events_near / max(self.events, 1)

    @property
    def points_share(self) -> float:
        """Share of map points near a line of the events."""
        return self.points_near / max(self.points, 1)


class Registration:
    """Registers batches with a map; keeps its drawing while the body has moved little.

    Args:
        views: the cameras.
        levels: scales of line fields; a wide search has one more.
        most_events: events of each camera that take part by themselves.
        per_camera: does the work of all cameras; by default in a thread each.
    """

    def __init__(
        self, views: Sequence[View], levels: int, most_events: int,
        per_camera: PerCamera | None = None,
    ) -> None:  # fmt: skip
        self._views, self._levels, self._most = tuple(views), levels, most_events
        self._per_camera = per_camera or PerCamera(len(views))
        self._maps = [DrawnMap(view, levels + 1) for view in views]
        self._events = [DrawnEvents(view, levels + 1) for view in views]
        self._drawn_at: Matrix | None = None
        self._drawn_levels = 0
        self._points = self._few = np.empty((0, 3))

    def use_map(self, points_world: Matrix, few_world: Matrix) -> None:
        """Takes (N, 3) points for lines, and (M, 3) of them for distances, instead of the last."""
        self._points, self._few, self._drawn_at = points_world, few_world, None

    def __call__(
        self, batches: Sequence[Events], expected: Motion, *, wide: bool = False
    ) -> tuple[Motion, Fit]:
        """The motion that fits a batch of every camera best, near what is expected, or wider."""
        T_body_world, levels = se3.inverse(expected.T_world_body), self._levels + wide
        T_drawn_world = self._draw_map(T_body_world, levels)
        twist, t_us = expected.twist, expected.t_us

        def draw(k: int) -> None:
            if self._maps[k].count:
                drawn, settings = self._maps[k], (twist, self._most, levels)
                self._events[k].draw(batches[k], t_us, drawn, *settings)

        self._per_camera(draw)
        T_now_drawn = T_as_expected = T_body_world @ se3.inverse(T_drawn_world)
        belief = np.linalg.inv(expected.covariance)
        fit, H = Fit(), belief
        for level in reversed(range(levels)):
            for _ in range(_COARSER_STEPS if level else _STEPS):
                H, g, fit = self._normal_equations(
                    batches, level, T_now_drawn, T_drawn_world, twist
                )
                off = se3.log(T_now_drawn @ se3.inverse(T_as_expected))
                H, g = _TRUST * H + belief, _TRUST * g
                g += belief @ np.concatenate([off, twist - expected.twist])
                step = np.linalg.solve(H, -g)
                T_now_drawn, twist = se3.exp(step[:6]) @ T_now_drawn, twist + step[6:]
                if np.abs(step[:6]).max() < _ENOUGH:
                    break
        # Rounding errors of products of poses would otherwise grow from batch to batch.
        T_world_body = se3.nearest_rigid(se3.inverse(T_now_drawn @ T_drawn_world))
        covariance = np.linalg.inv(H)
        found = replace(expected, T_world_body=T_world_body, twist=twist, covariance=covariance)
        return found, fit

    def _normal_equations(
        self,
        batches: Sequence[Events],
        level: int,
        T_now_drawn: Matrix,
        T_drawn_world: Matrix,
        twist: Matrix,
    ) -> tuple[Matrix, Matrix, Fit]:
        wide, gate = _CAUCHY_PX * (1 << level), _GATE_PX * (1 << level)
        T_body_world = T_now_drawn @ T_drawn_world

        def equations(k: int) -> tuple[Matrix, Matrix, Matrix]:
            H, g, counts = np.zeros((12, 12)), np.zeros(12), np.zeros(6)
            view, drawn, events = self._views[k], self._maps[k], self._events[k]
            if not drawn.count or not len(batches[k]):
                return H, g, counts
            lines = drawn.lines[level]
            counts[:3] = events_to_map(
                events.events, events.count, lines.moments, lines.cell_px, lines.least,
                drawn.depth.rho, drawn.depth.cell_px, T_now_drawn, twist, view.T_cam_body,
                view.T_body_cam, view.intrinsics, wide, gate, H, g,
            )  # fmt: skip
            lines = events.lines[level]
            counts[3:] = map_to_events(
                self._few, T_body_world, view.T_cam_body, view.intrinsics, view.size,
                lines.moments, lines.cell_px, lines.least, wide, gate, H[:6, :6], g[:6],
            )  # fmt: skip
            return H, g, counts

        H, g, counts = (sum(parts) for parts in zip(*self._per_camera(equations), strict=True))
        return H, g, Fit.of(counts)

    def _draw_map(self, T_body_world: Matrix, levels: int) -> Matrix:
        """Draws the map at a pose, unless it is drawn at one nearby; returns where."""
        drawn_at = self._drawn_at
        if (
            drawn_at is not None
            and levels <= self._drawn_levels
            and self._moved_px(T_body_world, drawn_at) < _REDRAW_PX
        ):
            return drawn_at
        self._drawn_at, self._drawn_levels = T_body_world, levels
        self._per_camera(lambda k: self._maps[k].draw(self._points, T_body_world, levels))
        return T_body_world

    def _moved_px(self, T_body_world: Matrix, drawn_at: Matrix) -> float:
        """About how far the map has moved in the images since it was drawn."""
        xi = se3.log(T_body_world @ se3.inverse(drawn_at))
        rho = max((float(drawn.depth.rho.mean()) for drawn in self._maps if drawn.count), default=1)
        focal_px = max(float(view.intrinsics[0]) for view in self._views)
        return focal_px * float(rho * np.linalg.norm(xi[:3]) + np.linalg.norm(xi[3:]))
