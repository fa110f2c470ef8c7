"""Who turns events into rays: what back-projection asks of a device, and the CPU's answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events
from emvs.data.recording import Recording
from emvs.geometry.camera import Camera
from emvs.ray_order import grouped_by_rows
from emvs.rays import RayCounts, Rays, event_rays
from emvs.split import concatenated, part, total
from emvs.view import ReferenceView


class AnyRays(Protocol):
    """Rays of one camera on some device; `len` is the number of those that vote.

    Attributes:
        counts: what became of the events.
    """

    @property
    def counts(self) -> RayCounts:
        """What became of the events."""

    def __len__(self) -> int: ...


class Joined(Protocol):
    """Pieces of one camera's rays that follow each other."""

    def between(self, first: int, last: int) -> AnyRays:
        """The rays of pieces `first` to `last`, exclusive."""


class Caster(Protocol):
    """Casts rays of one camera.

    Attributes:
        packets: the compatibility setting, see `emvs.rays.event_rays`.
    """

    packets: bool

    def __call__(self, events: Events) -> AnyRays:
        """Casts every event's ray into the reference view."""

    def joined(self, pieces: Sequence[Any]) -> Joined:
        """Rays that this caster cast, to be cut between them."""


class Projector(Protocol):
    """Turns events into rays on some device."""

    def received(self, events: Events) -> Events:
        """The events, where the device wants them."""

    def caster(
        self, recording: Recording, view: ReferenceView, camera: int, *, packets: bool
    ) -> Caster:
        """What casts rays of one camera."""

    def event_image(self, events: Events, width_px: int, height_px: int) -> NDArray[np.uint32]:
        """Events per pixel, (2, H, W): polarity 0, polarity 1."""


class CpuProjector:
    """The compiled loops on all cores."""

    def received(self, events: Events) -> Events:
        """The events as they are."""
        return events

    def caster(
        self, recording: Recording, view: ReferenceView, camera: int, *, packets: bool
    ) -> CpuCaster:
        """What casts rays of one camera."""
        return CpuCaster(recording, view, camera, packets=packets)

    def event_image(self, events: Events, width_px: int, height_px: int) -> NDArray[np.uint32]:
        """Events per pixel, (2, H, W): polarity 0, polarity 1."""
        cell = (events.p != 0).astype(np.intp)
        for size_px, place in ((height_px, events.y), (width_px, events.x)):
            cell *= size_px
            cell += place
        counts = np.bincount(cell, minlength=2 * height_px * width_px)
        return counts.astype(np.uint32).reshape(2, height_px, width_px)


class CpuCaster:
    """Casts rays of one camera, and groups them by rows of the reference view.

    Attributes:
        packets: the compatibility setting, see `emvs.rays.event_rays`.
    """

    def __init__(
        self, recording: Recording, view: ReferenceView, camera: int, *, packets: bool
    ) -> None:
        self._camera = _tabulated(recording.rig.cameras[camera])
        self._T_body_cam = recording.rig.T_body_cam[camera]
        self._trajectory, self._view, self.packets = recording.trajectory, view, packets

    def __call__(self, events: Events) -> Rays:
        """Casts every event's ray into the reference view (paper, Alg. 1, line 3)."""
        rays = event_rays(
            events, self._camera, self._T_body_cam, self._trajectory, self._view.T_world_rv,
            self._view.camera, packets=self.packets,
        )  # fmt: skip
        middle = float(self._view.rho[len(self._view.rho) // 2])
        return grouped_by_rows(rays, middle, self._view.camera.height_px)

    def joined(self, pieces: Sequence[Rays]) -> CpuJoined:
        """Rays that this caster cast, to be cut between them."""
        return CpuJoined(pieces)


class CpuJoined:
    """Pieces of one camera's rays, copied into one; every stretch of pieces is a view."""

    def __init__(self, pieces: Sequence[Rays]) -> None:
        self._whole, self._counts = concatenated(pieces), [piece.counts for piece in pieces]
        self._starts = np.r_[0, np.cumsum([count.rays for count in self._counts])]

    def between(self, first: int, last: int) -> Rays:
        """The rays of pieces `first` to `last`, exclusive."""
        if (first, last) == (0, len(self._counts)):
            return self._whole
        start, stop = int(self._starts[first]), int(self._starts[last])
        return part(self._whole, start, stop, total(self._counts[first:last]))


class _Tabulated(Camera):
    """A camera that works out its table of bearings once, for all its sub-intervals."""

    @cached_property
    def _table(self) -> NDArray[np.float64]:
        return super().bearing_table()

    def bearing_table(self) -> NDArray[np.float64]:
        return self._table


def _tabulated(camera: Camera) -> Camera:
    return _Tabulated(**{field.name: getattr(camera, field.name) for field in fields(camera)})
