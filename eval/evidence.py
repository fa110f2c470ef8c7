"""What ground truth and events say about bad pixels: the tests behind `eval.taxonomy`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from emvs.data.sequence import Sequence as EventSequence
from emvs.geometry import se3
from eval.geometry import Flags, Floats, Pixels, pixel_of
from eval.masks import log_gradient, on_view
from eval.seen import EventCounts
from eval.taxonomy import count_causes

MIN_EVENTS = 3
"""Fewer events of the true point in one of the cameras are too few."""
HIDDEN = 0.05
"""A point that lies this share deeper than the surface seen there is hidden."""
OTHER_PLACE_PX = 2.0
"""A match this far from the true point's image is another one."""
SIMILAR_COSINE = float(np.cos(np.pi / 4))
"""Edges are similar if their gradients differ by less than 45°, and less than a factor of 2."""
SIMILAR_FACTOR = 2.0


@dataclass(frozen=True)
class Evidence:
    """One window of a sequence, as the tests need it.

    Attributes:
        sequence: with ground truth of all cameras at `t_us`.
        t_us: time of the reference view, camera 0's place, µs.
        counts: events of each camera during the window.
        truth_m: (H, W) true z-depth in the undistorted view of camera 0, m.
        range_m: nearest and farthest plane that were swept, m.
        masks: regions of the view by name, see `eval.masks`.
        contrast: gradient of log intensity that makes an edge, 1/px.
    """

    sequence: EventSequence
    t_us: int
    counts: tuple[EventCounts, ...]
    truth_m: NDArray[np.floating]
    range_m: tuple[float, float]
    masks: Mapping[str, Flags] = field(default_factory=dict)
    contrast: float = 0.1

    def causes(self, estimate_m: NDArray[np.floating], bad: Flags) -> dict[str, int]:
        """Counts the causes of one method's bad pixels.

        Args:
            estimate_m: (H, W) estimated z-depth, m.
            bad: (H, W) the bad pixels; they have an estimate and a truth.
        """
        rows, columns = np.nonzero(bad)
        true_m, wrong_m = (depth[bad].astype(np.float64) for depth in (self.truth_m, estimate_m))
        true_world = self._points_world(rows, columns, true_m)
        wrong_world = self._points_world(rows, columns, wrong_m)
        near_m, far_m = self.range_m
        nowhere = np.zeros(bad.shape, np.bool_)
        flags = {
            "out_of_range": (true_m < near_m) | (true_m > far_m),
            "moving": self.masks.get("moving", nowhere)[bad],
            "occlusion": self.masks.get("boundary", nowhere)[bad] | self._hidden(true_world),
            "repeated": self._repeated(rows, columns, true_world, wrong_world),
            **self._by_events(true_world, wrong_world),
        }
        return count_causes(flags, len(rows))

    def _by_events(self, true_world: Floats, wrong_world: Floats) -> dict[str, Flags]:
        """What the events of all cameras say: (N,) flags of three causes."""
        true, _ = np.stack([counts.near(true_world) for counts in self.counts], axis=1)
        wrong, noise = np.stack([counts.near(wrong_world) for counts in self.counts], axis=1)
        return {
            "few_events": true.min(axis=0) < MIN_EVENTS,
            "noise": 2 * noise.sum(axis=0) > wrong.sum(axis=0),
            "ambiguous": (wrong >= true).all(axis=0),
        }

    @cached_property
    def _T_world_cam(self) -> list[Floats]:
        T_world_body = self.sequence.trajectory.at(self.t_us)
        return [T_world_body @ T_body_cam for T_body_cam in self.sequence.rig.T_body_cam]

    def _points_world(self, rows: Pixels, columns: Pixels, depth_m: Floats) -> Floats:
        view = self.sequence.rig.cameras[0].undistorted()
        bearing = view.unproject(np.stack([columns, rows], axis=-1).astype(np.float64))
        points = np.column_stack([bearing, np.ones(len(rows))]) * depth_m[:, None]
        return se3.transform(self._T_world_cam[0], points)

    def _hidden(self, points_world: Floats) -> Flags:
        """Whether another camera sees something nearer in the point's place."""
        hidden = np.zeros(len(points_world), np.bool_)
        for k in range(1, len(self.sequence.rig)):
            points = se3.transform(se3.inverse(self._T_world_cam[k]), points_world)
            row, column, inside = pixel_of(self.sequence.rig.cameras[k], points)
            seen_m = self.sequence.truth_depth_m(k, self.t_us)[row, column]
            hidden |= inside & (points[:, 2] > (1 + HIDDEN) * seen_m)
        return hidden

    def _repeated(
        self, rows: Pixels, columns: Pixels, true_world: Floats, wrong_world: Floats
    ) -> Flags:
        """Whether the wrong point meets another, similar edge in another camera."""
        found = np.zeros(len(rows), np.bool_)
        here = self._gradients[0][rows, columns]
        for k in range(1, len(self.sequence.rig)):
            camera = self.sequence.rig.cameras[k]
            T_cam_world = se3.inverse(self._T_world_cam[k])
            wrong = se3.transform(T_cam_world, wrong_world)
            row, column, inside = pixel_of(camera, wrong)
            apart_px = camera.project(wrong) - camera.project(
                se3.transform(T_cam_world, true_world)
            )
            elsewhere = np.hypot(apart_px[:, 0], apart_px[:, 1]) > OTHER_PLACE_PX
            there = self._gradients[k][row, column]
            found |= inside & elsewhere & similar(here, there, self.contrast)
        return found

    @cached_property
    def _gradients(self) -> list[Floats]:
        """Per camera, the strongest gradient within one pixel; camera 0's in its view."""
        images = [
            self.sequence.truth_intensity(k, self.t_us) for k in range(len(self.sequence.rig))
        ]
        images[0] = on_view(images[0], self.sequence.rig.cameras[0])
        return [strongest(log_gradient(image)) for image in images]


def similar(a: Floats, b: Floats, contrast: float) -> Flags:
    """Whether (N, 2) gradients are both edges, of similar strength and direction, sign included."""
    a_size, b_size = np.hypot(a[:, 0], a[:, 1]), np.hypot(b[:, 0], b[:, 1])
    edges = np.minimum(a_size, b_size) >= contrast
    strength = np.maximum(a_size, b_size) <= SIMILAR_FACTOR * np.minimum(a_size, b_size)
    alike: Flags = np.sum(a * b, axis=1) >= SIMILAR_COSINE * a_size * b_size
    return edges & strength & alike


def strongest(gradient: Floats) -> Floats:
    """At each pixel, the (H, W, 2) gradient of greatest size within one row and column."""
    padded = np.pad(gradient, ((1, 1), (1, 1), (0, 0)))
    height, width = gradient.shape[:2]
    best = gradient
    for down in range(3):
        for right in range(3):
            other = padded[down : down + height, right : right + width]
            larger = np.sum(other**2, axis=-1) > np.sum(best**2, axis=-1)
            best = np.where(larger[..., None], other, best)
    return best
