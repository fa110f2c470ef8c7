"""Why pixels are bad: one cause for each, by what ground truth and events say of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.eval.scoring.regions import log_gradient, on_view
from eventsweep.sim.sensor.labels import Label

CAUSES: dict[str, str] = {
    "out_of_range": "the true depth lies outside the planes that were swept",
    "moving": "the pixel shows something that moves by itself",
    "occlusion": "at a depth discontinuity, or hidden from another camera",
    "repeated": "the wrong point meets another, similar edge in another camera",
    "few_events": "a camera has too few events where the true point was seen",
    "noise": "most events where the wrong point would be seen are noise",
    "ambiguous": "every camera has as many events for the wrong point as for the true one, or more",
    "other": "none of these: the events favour the true depth",
}
"""Causes in the order in which they are tested, each with its test."""
MIN_EVENTS = 3
"""Fewer events of the true point in one of the cameras are too few."""
HIDDEN = 0.05
"""A point that lies this share deeper than the surface seen there is hidden."""
OTHER_PLACE_PX = 2.0
"""A match this far from the true point's image is another one."""
SIMILAR_COSINE = float(np.cos(np.pi / 4))
"""Edges are similar if their gradients differ by less than 45°, and less than a factor of 2."""
SIMILAR_FACTOR = 2.0
SLICES = 32
"""Pieces of a window in each of which the camera is taken to stand still."""
Floats = NDArray[np.float64]
Pixels = NDArray[np.int64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.uint16]
Causes = NDArray[np.uint8]


@dataclass(frozen=True)
class OutlierClassifier:
    """Finds the causes of bad pixels in one window of a sequence.

    Attributes:
        sequence: with ground truth of all cameras at `t_us`.
        t_us: time of the reference view, camera 0's place, µs.
        counts: events of each camera during the window.
        truth_m: (H, W) true z-depth in the undistorted view of camera 0, m.
        range_m: nearest and farthest plane that were swept, m.
        masks: regions of the view by name, see `eval.scoring.regions`.
        contrast: gradient of log intensity that makes an edge, 1/px.
    """

    sequence: EventSequence
    t_us: int
    counts: tuple[EventCounts, ...]
    truth_m: NDArray[np.floating]
    range_m: tuple[float, float]
    masks: Mapping[str, Flags] = field(default_factory=dict)
    contrast: float = 0.1

    def count(self, estimate_m: NDArray[np.floating], bad: Flags) -> dict[str, int]:
        """Counts one method's bad pixels by cause; arguments as of `causes`.

        Without `moving` where no segmentation says what moves: it is not measured.
        """
        counts = counts_by_cause(self.causes(estimate_m, bad))
        return {
            cause: n for cause, n in counts.items() if cause != "moving" or "moving" in self.masks
        }

    def causes(self, estimate_m: NDArray[np.floating], bad: Flags) -> Causes:
        """The cause of each of one method's bad pixels.

        Args:
            estimate_m: (H, W) estimated z-depth, m.
            bad: (H, W) the bad pixels; they have an estimate and a truth.

        Returns:
            (N,) positions in `CAUSES`, of the bad pixels row by row.
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
        return first_causes(flags, len(rows))

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


def first_causes(flags: Mapping[str, Flags], bad: int) -> Causes:
    """The first cause of each bad pixel.

    Args:
        flags: per cause, (N,) whether it applies to each bad pixel; a missing cause applies to
            none, and what no cause applies to is `other`.
        bad: N.

    Returns:
        (N,) positions in `CAUSES`.
    """
    names = list(CAUSES)
    found = np.full(bad, names.index("other"), np.uint8)
    for position in reversed(range(len(names))):
        if names[position] in flags:
            found[flags[names[position]]] = position
    return found


def counts_by_cause(causes: Causes) -> dict[str, int]:
    """Counts of all causes, which add up to the number of bad pixels."""
    counts = np.bincount(causes, minlength=len(CAUSES))
    return dict(zip(CAUSES, counts.tolist(), strict=True))


def pooled_causes(parts: Sequence[Mapping[str, int] | None]) -> dict[str, int] | None:
    """Adds counts of several windows, of the causes that all know; None where any has none."""
    known = [part for part in parts if part is not None]
    if not known or len(known) < len(parts):
        return None
    shared = (cause for cause in CAUSES if all(cause in part for part in known))
    return {cause: sum(part[cause] for part in known) for cause in shared}


@dataclass(frozen=True, eq=False)
class EventCounts:
    """Events of one camera during a window, by pixel and piece of time.

    Attributes:
        camera: the sensor.
        T_cam_world: (S, 4, 4) at the middle of each piece.
        events: (S, H, W) events within one row and column of each pixel.
        noise: the same for events whose label is not signal; None where no labels are stored.
    """

    camera: Camera
    T_cam_world: Floats
    events: Counts
    noise: Counts | None

    def near(self, points_world: Floats) -> tuple[Floats, Floats]:
        """Counts events within one pixel of where each point is seen as the camera moves.

        Args:
            points_world: (N, 3), m.

        Returns:
            (N,) events, and (N,) noise among them.
        """
        totals = np.zeros((2, len(points_world)))
        for piece, T_cam_world in enumerate(self.T_cam_world):
            row, column, inside = pixel_of(self.camera, se3.transform(T_cam_world, points_world))
            totals[0] += inside * self.events[piece, row, column]
            if self.noise is not None:
                totals[1] += inside * self.noise[piece, row, column]
        return totals[0], totals[1]


def count_events(
    sequence: EventSequence, camera: int, t0_us: int, t1_us: int, slices: int = SLICES
) -> EventCounts:
    """Counts a camera's events in the window from `t0_us` to before `t1_us`."""
    model = sequence.rig.cameras[camera]
    edges_us = np.linspace(t0_us, t1_us, slices + 1).astype(np.int64)
    first_us, last_us = sequence.trajectory.span_us
    middles_us = np.clip((edges_us[1:] + edges_us[:-1]) // 2, first_us, last_us)
    T_world_cam = sequence.trajectory.at(middles_us) @ sequence.rig.T_body_cam[camera]
    pieces = list(zip(edges_us[:-1].tolist(), edges_us[1:].tolist(), strict=True))
    found = [sequence.events(camera, *piece) for piece in pieces]
    events = np.stack([_image(part.x, part.y, model) for part in found])
    noise = None
    if has_labels(sequence):
        noisy = [sequence.labels(camera, *piece) != Label.SIGNAL for piece in pieces]
        parts = zip(found, noisy, strict=True)
        noise = np.stack([_image(part.x[bad], part.y[bad], model) for part, bad in parts])
    return EventCounts(model, se3.inverse(T_world_cam), events, noise)


def has_labels(sequence: EventSequence) -> bool:
    """Whether each event's cause is stored: not where the sensor was ideal."""
    return "sensor.json" in sequence.manifest.files


def _image(x: NDArray[np.uint16], y: NDArray[np.uint16], camera: Camera) -> Counts:
    """(H, W) events within one row and column of each pixel."""
    shape = camera.height_px, camera.width_px
    flat = y.astype(np.int64) * camera.width_px + x
    image = np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float32)
    # Border: what lies outside the sensor made no events.
    total = cv2.boxFilter(image, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.minimum(np.rint(total), np.iinfo(np.uint16).max).astype(np.uint16)


def pixel_of(camera: Camera, points_cam: Floats) -> tuple[Pixels, Pixels, Flags]:
    """Finds the sensor's pixel of each point: (N,) row, column, and whether there is one.

    Where there is none, row and column are 0, so that they can index an image.
    """
    uv_px = np.nan_to_num(np.rint(camera.project(points_cam)), nan=-1.0)
    column, row = np.clip(uv_px, -1, 1e9).astype(np.int64).T
    inside = (column >= 0) & (row >= 0) & (column < camera.width_px) & (row < camera.height_px)
    return np.where(inside, row, 0), np.where(inside, column, 0), inside
