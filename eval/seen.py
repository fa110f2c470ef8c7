"""How many events of a window lie where a camera saw a given point."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs.data.sequence import Sequence
from emvs.geometry import se3
from emvs.geometry.camera import Camera
from eval.geometry import pixel_of
from sim.sensor.labels import Label

SLICES = 32
"""Pieces of a window in each of which the camera is taken to stand still."""

Floats = NDArray[np.float64]
Counts = NDArray[np.uint16]


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
    sequence: Sequence, camera: int, t0_us: int, t1_us: int, slices: int = SLICES
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


def has_labels(sequence: Sequence) -> bool:
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
