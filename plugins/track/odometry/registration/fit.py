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
from eventsweep.plugins.track.odometry.checkpoint import State
from eventsweep.plugins.track.odometry.motion import Motion
from eventsweep.plugins.track.odometry.registration.gauss_newton_kernels import (
    CAUCHY_PX,
    FARTHER,
    GATE_PX,
    TRUST,
    gauss_newton,
)
from eventsweep.plugins.track.odometry.registration.residuals_kernels import (
    depth_to_events,
    depths_to_events,
)
from eventsweep.plugins.track.odometry.registration.views import DrawnEvents, DrawnMap, View

Matrix = NDArray[np.float64]
LEAST_INLIERS = 100
AGREES, FOUND_AGAIN = 0.6, 0.65
"""Mean weight of residuals: 0.36 by chance. Once lost, more is needed to go on."""
_ONE_CAMERA = 1e-9  # share of the information about scale that rounding leaves
_REGIONS = 6, 8  # rows and columns of them in an image
_LEAST_POINTS, _REGION_AGREES = 10, 0.55  # of a region; its closeness
_NEAR_PX = 1.0  # so little beside what was expected needs no coarser level
_SURPRISE, _MUST_GAIN = 4.0, 1.02  # chi-squared of 12, mostly 1; of what agrees
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
    def agreement(self) -> float:
        """Residuals near zero."""
        return self.closeness * self.inliers

    def is_good(self, closeness: float) -> bool:
        """Whether enough residuals decided, and their closeness is at least this."""
        return self.inliers >= LEAST_INLIERS and self.closeness >= closeness

    def in_words(self) -> str:
        """How well it went, and what that counts."""
        return (
            f"events and map agree to {self.closeness:.2f} (0.36 is chance): {self.events_near} of "
            f"{self.events} events are near lines of the map, {self.points_near} of {self.points} "
            "map points near lines of events"
        )


@dataclass(frozen=True)
class Evidence:
    """What the cameras see at once, and where, of a map: whatever the motion was.

    Attributes:
        scale_off: by what share the map seems too small.
        scale_sigma: the standard deviation of that: infinite where one camera sees all.
        regions_off: share of the images' regions in which events and map do not agree.
    """

    scale_off: float
    scale_sigma: float
    regions_off: float


class Registration:
    """Registers batches with a map; keeps its drawing while the body has moved little.

    Args:
        views: the cameras.
        levels: scales of line fields; a wide search has one more.
        most_events: events of each camera that take part by themselves.
    """

    def __init__(self, views: Sequence[View], levels: int, most_events: int) -> None:
        self._levels = levels
        names = "T_cam_body", "T_body_cam", "adjoint", "intrinsics", "size"
        self._cameras = tuple(np.stack([getattr(v, name) for v in views]) for name in names)
        self._focal_px = max(float(view.intrinsics[0]) for view in views)
        self._map = DrawnMap(views, levels + 1)
        self._events = DrawnEvents(views, levels + 1, most_events)
        self._drawn_at: Matrix | None = None
        self._drawn_levels = 0
        self._points = self._few = np.empty((0, 3))
        self._normals = np.empty((len(views), 0, 2))

    def use_map(self, points_world: Matrix, few_world: Matrix) -> None:
        """Takes (N, 3) points for lines, and (M, 3) of them for distances, instead of the last."""
        self._points, self._few, self._drawn_at = points_world, few_world, None

    def state(self) -> State:
        """The map, and where it is drawn."""
        drawn = {"drawn_at": self._drawn_at, "levels": self._drawn_levels}
        return {"points": self._points, "few": self._few, **drawn}

    def restore(self, state: State) -> None:
        """Takes the map of a `state`, and draws it where it was."""
        self.use_map(state["points"], state["few"])
        if state["drawn_at"] is not None:
            self._draw_map(state["drawn_at"], state["levels"])

    def __call__(
        self, batches: Sequence[Events], expected: Motion, *, wide: bool = False
    ) -> tuple[Motion, Fit]:
        """The motion that fits a batch of every camera best, near what is expected, or wider."""
        return self._from_level(self._levels + wide, batches, expected)

    def nearby(
        self, batches: Sequence[Events], expected: Motion, *, judged: bool = False
    ) -> tuple[Motion, Fit]:
        """The same by the finest level alone, where that agrees and is near what is expected.

        If `judged`, what drifts although the expected twist is taken out moves by itself, and takes
        no part. If the twist is another than expected, that leaves out what would say so.
        """
        motion, fit = self._from_level(1, batches, expected, judged=judged)
        poses = se3.inverse(motion.T_world_body), se3.inverse(expected.T_world_body)
        if fit.is_good(AGREES) and self._moved_px(*poses) < _NEAR_PX:
            return motion, fit
        return self._from_level(self._levels, batches, expected, judged=judged)

    def nearby_or_turned(
        self, batches: Sequence[Events], expected: Motion, unsettled: Motion
    ) -> tuple[Motion, Fit]:
        """The same, or one near `unsettled`, which knows no motion, where that agrees better.

        It is tried where the first fits badly, or is another than was to be expected: then the body
        may have been stopped or turned back at once.
        """
        motion, fit = self.nearby(batches, expected)
        if fit.is_good(AGREES) and motion.surprise(expected) <= _SURPRISE:
            return motion, fit
        other, other_fit = self(batches, unsettled, wide=True)
        if other_fit.agreement > _MUST_GAIN * fit.agreement:
            return other, other_fit
        return self.nearby(batches, expected)  # what was drawn last is what `evidence` sees

    def _from_level(
        self, levels: int, batches: Sequence[Events], expected: Motion, *, judged: bool = False
    ) -> tuple[Motion, Fit]:
        """The motion that the finest so many levels give, the coarsest of them first."""
        T_body_world = se3.inverse(expected.T_world_body)
        T_drawn_world = self._draw_map(T_body_world, levels)
        self._events.draw(batches, expected.t_us, self._map, expected.twist, levels, judged=judged)
        T_now_drawn, twist = np.empty((4, 4)), np.empty(6)
        H, counts = np.linalg.inv(expected.covariance), np.zeros(6)
        map_lines, event_lines = self._map.lines, self._events.lines
        gauss_newton(
            self._events.events, self._events.counts, self._few, self._normals,
            map_lines.field, event_lines.field,
            map_lines.places, self._cameras, levels,
            T_body_world @ se3.inverse(T_drawn_world), T_drawn_world, expected.twist, H.copy(),
            T_now_drawn, twist, H, counts,
        )  # fmt: skip
        # Rounding errors of products of poses would otherwise grow from batch to batch.
        T_world_body = se3.nearest_rigid(se3.inverse(T_now_drawn @ T_drawn_world))
        covariance = np.linalg.inv(H)
        motion = replace(expected, T_world_body=T_world_body, twist=twist, covariance=covariance)
        return motion, Fit.of(counts)

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
        self._map.draw(self._points, T_body_world, levels)
        self._normals = self._map.normals(self._few, T_body_world)
        return T_body_world

    def evidence(self, motion: Motion) -> Evidence:
        """How the last batch, at the motion that fits it, speaks for the map or against it."""
        H, g = np.zeros((7, 7)), np.zeros(7)
        regions = np.zeros((len(self._events.counts), *_REGIONS, 2))
        T_body_world, lines = se3.inverse(motion.T_world_body), self._events.lines
        T_cam_body, _, _, intrinsics, sizes = self._cameras
        for k in np.flatnonzero(self._events.counts >= 0):
            depth_to_events(
                self._few, self._normals[k], T_cam_body[k], T_body_world, intrinsics[k], sizes[k],
                lines.places[k, 0], lines.field, CAUCHY_PX, GATE_PX, H, g,
                regions[k],
            )  # fmt: skip
        near, close = regions[regions[..., 0] >= _LEAST_POINTS].T
        regions_off = float(np.mean(close < _REGION_AGREES * near)) if len(near) else 1.0
        gain = np.linalg.lstsq(H[:6, :6], H[:6, 6], rcond=None)[0]
        information = H[6, 6] - gain @ H[:6, 6]
        if information <= _ONE_CAMERA * max(H[6, 6], 1.0):
            return Evidence(0.0, np.inf, regions_off)
        off = FARTHER * (gain @ g[:6] - g[6]) / information
        return Evidence(float(off), float((TRUST * information) ** -0.5), regions_off)

    @property
    def few(self) -> Matrix:
        """The (M, 3) points in use for distances."""
        return self._few

    def add_depths(
        self, batches: Sequence[Events], motion: Motion, points: Matrix, middle_m: Matrix,
        parts: tuple[Matrix, ...],
    ) -> None:  # fmt: skip
        """Adds what a batch at a motion says of its pose, and of how deep points lie.

        Args:
            batches: events of every camera.
            motion: near the one that fits them.
            points: (M, 3) those of `few`, at other depths from `middle_m`, (3,).
            middle_m: where depths are seen from, in the world.
            parts: H, g, a, b and c of `depths_to_events`.
        """
        T_body_world = se3.inverse(motion.T_world_body)
        self._draw_map(T_body_world, 1)
        self._events.draw(batches, motion.t_us, self._map, motion.twist, 1, judged=True)
        T_cam_body, _, _, intrinsics, sizes = self._cameras
        lines = self._events.lines
        for k in np.flatnonzero(self._events.counts >= 0):
            depths_to_events(
                points, self._normals[k], middle_m, T_cam_body[k], T_body_world, intrinsics[k],
                sizes[k], lines.places[k, 0], lines.field, CAUCHY_PX, GATE_PX,
                *parts,
            )  # fmt: skip

    @property
    def rho(self) -> float:
        """The map's mean inverse depth where it is nearest, 1/m."""
        return self._map.rho

    def in_px(self, length_m: float) -> float:
        """About how long a length is in the images."""
        return self._focal_px * self._map.rho * length_m

    def between_px(self, before: Motion, after: Motion) -> float:
        """How far the images moved on the way that shows depth; turns show none, and count half."""
        by_way, by_turn = self._parts_px(se3.inverse(before.T_world_body) @ after.T_world_body)
        return max(by_way, (by_way + by_turn) / 2)

    def speed_px_s(self, motion: Motion) -> float:
        """About how fast the images move."""
        return self._focal_px * float(
            self._map.rho * np.linalg.norm(motion.twist[:3]) + np.linalg.norm(motion.twist[3:])
        )

    def _moved_px(self, T_body_world: Matrix, drawn_at: Matrix) -> float:
        """About how far the map has moved in the images since it was drawn."""
        return sum(self._parts_px(T_body_world @ se3.inverse(drawn_at)))

    def _parts_px(self, T: Matrix) -> tuple[float, float]:
        """About how far a motion moves the images, by its way and by its turn."""
        xi = se3.log(T)
        way, turn = np.linalg.norm(xi[:3]), np.linalg.norm(xi[3:])
        return float(self._focal_px * self._map.rho * way), float(self._focal_px * turn)
