"""Batches of events: the newest of every camera, as many as an image of this size needs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.track.odometry.registration.events_kernels import NEVER_US, in_company
from eventsweep.plugins.track.odometry.stream import Stream

LONGEST_US = 40_000
NOISE = "events lie anywhere alike: noise, no edges"
COMPANY_US = 20_000
_EVENTS_PER_COLUMN = 30  # that make the edges of an image visible, for half of its pixels' height
_STILL_PER_PIXEL = 0.005  # with fewer events no edge has moved by a pixel
_POINTS_PER_COLUMN = 24
_USUAL_COLUMNS = 400
# Noise reaches 1.5 once lone events are left out; scenes begin at 2.8, real ones at 6.
_SQUARE_PX, _ANYWHERE = 4, 1.6
_MAP_EVENTS_PER_COLUMN, _LEAST_MAP_EVENTS = 170, 60_000


class Sizes:
    """Numbers that follow from the cameras' sizes.

    Attributes:
        events: newest events of each camera that make a batch.
        own_time: of those, how many take part each at its own time.
        still: events of all cameras together below which nothing moves.
        lines: map points that lines are made of.
        distances: map points whose distances from lines of the events count.
        levels: scales of line fields.
        map: events of each camera that make a map.
    """

    def __init__(self, rig: Rig) -> None:
        columns = max(camera.width_px for camera in rig.cameras)
        pixels = sum(camera.width_px * camera.height_px for camera in rig.cameras)
        self.events = _EVENTS_PER_COLUMN * columns
        self.own_time, self.distances = 1250, 1000
        self.still = round(_STILL_PER_PIXEL * pixels)
        self.lines = _POINTS_PER_COLUMN * columns
        self.levels = 2 + max(0, round(math.log2(columns / _USUAL_COLUMNS)))
        self.map = max(_LEAST_MAP_EVENTS, _MAP_EVENTS_PER_COLUMN * columns)


@dataclass(frozen=True, eq=False)
class Batch:
    """Events of every camera, and the time that their pose belongs to: the middle of theirs."""

    t_us: int
    events: tuple[Events, ...]

    def __len__(self) -> int:
        return sum(map(len, self.events))


def shows_edges(batch: Batch) -> bool:
    """Whether the events of any camera crowd somewhere, as edges do; noise lies anywhere alike.

    Where a map has many lines, noise lies near some: agreement with it says nothing then.
    """
    return any(_crowding(events) > _ANYWHERE for events in batch.events if len(events))


def _crowding(events: Events) -> float:
    """Variance over mean of the counts in squares, in all that the events span: 1 by chance."""
    columns, rows = int(events.x.max()) // _SQUARE_PX + 1, int(events.y.max()) // _SQUARE_PX + 1
    cell = (events.y // _SQUARE_PX).astype(np.int64) * columns + events.x // _SQUARE_PX
    counts = np.bincount(cell, minlength=columns * rows)
    return float(counts.var() / counts.mean())


def never_fired(camera: Camera) -> NDArray[np.int64]:
    """When each pixel fired last, before any has; for `without_lone`."""
    return np.full((camera.height_px + 2, camera.width_px + 2), NEVER_US)


def without_lone(packet: Events, fired_us: NDArray[np.int64]) -> Events:
    """The events that have company, `in_company`; `fired_us` is kept up to date."""
    kept = np.empty(len(packet), np.bool_)
    in_company(packet.x, packet.y, packet.t_us, COMPANY_US, fired_us, kept)
    return packet.take(kept)


def batch_before(streams: Sequence[Stream], t_us: int, count: int, since_us: int) -> Batch:
    """The newest `count` events of each camera before `t_us`, of the same stretch of time.

    The camera with most events decides how long that is; it begins at `since_us` at the earliest.
    """
    begins = [stream.time_of_newest(count, t_us) for stream in streams]
    begin_us = max([t_us - LONGEST_US, since_us, *(b for b in begins if b is not None)])
    events = tuple(stream.between(begin_us, t_us) for stream in streams)
    return Batch((begin_us + t_us) // 2, events)


def rising(batches: Sequence[Batch]) -> list[Batch]:
    """Batches whose times rise."""
    kept: list[Batch] = []
    for batch in batches:
        if not kept or batch.t_us > kept[-1].t_us:
            kept.append(batch)
    return kept
