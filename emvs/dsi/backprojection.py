"""Back-projection: from a window of a recording to the rays of every camera's events."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.dsi.fusion import Split
from eventsweep.emvs.dsi.rays import RayCounts, Rays, grouped_by_rows, knots, rays_between
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.reference_view import ReferenceView
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.emvs.windows import Window


@dataclass(frozen=True, eq=False)
class Projected:
    """Every camera's rays, cut as each split asks for.

    Attributes:
        rays: split -> rays of each volume, in the order polarity, camera, sub-interval.
        counts: per camera, what became of its events under the first split.
        event_image: (2, H, W) uint32 events of camera 0 per pixel: darker, brighter.
    """

    rays: Mapping[Split, list[AnyRays]]
    counts: list[RayCounts]
    event_image: NDArray[np.uint32]


def back_project(
    recording: Recording,
    window: Window,
    view: ReferenceView,
    splits: Sequence[Split],
    projector: Projector,
    progress: Progress = silent,
    *,
    polarities: int = 1,
    packets: bool = False,
    min_events: int = 1,
) -> Projected:
    """Casts the rays of every camera in the window into the reference view (paper, Alg. 1, line 3).

    `progress` is called with the stage `rays`, cameras done and all. Where `polarities` is 2, each
    gets rays of its own; `packets` is the setting of `emvs.dsi.rays.rays_between`.

    Raises:
        InputError: a camera with fewer than `min_events` events that can vote.
    """
    cast, counts = [], []
    for k, camera in enumerate(recording.rig.cameras):
        events = projector.received(recording.events(k, window.t0_us, window.t1_us))
        caster = projector.caster(recording, view, k, packets=packets)
        pieces = _of_camera(caster, events, window, splits, polarities)
        count = RayCounts.total([rays.counts for parts in pieces[splits[0]] for rays in parts])
        _check_any(recording.rig.camera_names[k], count, window, min_events)
        if k == 0:
            event_image = projector.event_image(events, camera.width_px, camera.height_px)
        lost = window.left_out[k]  # no pose covers these, and nobody read them
        counts.append(
            replace(count, events=count.events + lost, without_pose=count.without_pose + lost)
        )
        cast.append(pieces)
        progress("rays", k + 1, len(recording.rig))
    ordered = {
        split: [rays for p in range(polarities) for pieces in cast for rays in pieces[split][p]]
        for split in splits
    }
    return Projected(ordered, counts, event_image)


# per split: per polarity: the rays of each sub-interval
_Pieces = dict[Split, list[list["AnyRays"]]]


def _of_camera(
    caster: Caster, events: Events, window: Window, splits: Sequence[Split], polarities: int
) -> _Pieces:
    edges = {split: split.edges(events.t_us, window.t0_us, window.t1_us) for split in splits}
    pieces: _Pieces = {split: [] for split in splits}
    cut = _cut_packets if caster.packets else _cut_shared
    for polarity in range(polarities):
        chosen, cuts = _of_polarity(events, edges, polarity) if polarities == 2 else (events, edges)
        for split, parts in cut(caster, chosen, cuts).items():
            pieces[split].append(parts)
    return pieces


def _of_polarity(
    events: Events, edges: Mapping[Split, NDArray[np.int64]], polarity: int
) -> tuple[Events, dict[Split, NDArray[np.int64]]]:
    chosen = events.p == polarity
    before = np.r_[0, np.cumsum(chosen)]
    return events.take(chosen), {split: before[edge] for split, edge in edges.items()}


def _cut_packets(
    caster: Caster, events: Events, edges: Mapping[Split, NDArray[np.int64]]
) -> dict[Split, list[AnyRays]]:
    """Every sub-interval has packets and a dropped tail of its own, as in the authors' program."""
    return {
        split: [caster(events.slice(int(i), int(j))) for i, j in pairwise(edge)]
        for split, edge in edges.items()
    }


def _cut_shared(
    caster: Caster, events: Events, edges: Mapping[Split, NDArray[np.int64]]
) -> dict[Split, list[AnyRays]]:
    """Casts every event once; the sub-intervals of all splits share the same rays."""
    every = np.unique(np.concatenate([*edges.values(), [0, len(events)]]))
    pieces = [caster(events.slice(int(i), int(j))) for i, j in pairwise(every)] or [caster(events)]
    between = caster.joined(pieces)
    cut: dict[Split, list[AnyRays]] = {}
    for split, edge in edges.items():
        at = np.searchsorted(every, edge) if split.intervals > 1 else (0, len(pieces))
        cut[split] = [between(int(i), int(j)) for i, j in pairwise(at)]
    return cut


def _check_any(name: str, counts: RayCounts, window: Window, min_events: int) -> None:
    if counts.rays < min_events:
        can = str(counts.rays) if counts.rays else "none"
        raise InputError(
            f"camera {name} has {counts.events} events in the window of "
            f"{(window.t1_us - window.t0_us) / 1e6:.6f} s, {can} of which can vote: needs at "
            f"least {min_events} (1025 or more in the mcemvs setting); choose another window or "
            "check poses and calibration"
        )


class AnyRays(Protocol):
    """Rays of one camera on some device; `len` is the number of those that vote."""

    @property
    def counts(self) -> RayCounts:
        """What became of the events."""

    def __len__(self) -> int: ...


# Of pieces of one camera's rays that follow each other: those of pieces i to j, exclusive
Between = Callable[[int, int], AnyRays]


class Caster(Protocol):
    """Casts rays of one camera; `packets` is the setting of `emvs.dsi.rays.rays_between`."""

    packets: bool

    def __call__(self, events: Events) -> AnyRays:
        """Casts every event's ray into the reference view."""

    def joined(self, pieces: Sequence[Any]) -> Between:
        """Rays that this caster cast, to be cut between them."""


class Projector(Protocol):
    """Turns events into rays on some device."""

    def reading(
        self, recording: Recording, windows: Sequence[Window]
    ) -> AbstractContextManager[Recording]:
        """The recording, for a run that maps these windows one after the other."""

    def received(self, events: Events) -> Events:
        """The events, where the device wants them."""

    def caster(
        self, recording: Recording, view: ReferenceView, camera: int, *, packets: bool
    ) -> Caster:
        """What casts rays of one camera."""

    def event_image(self, events: Events, width_px: int, height_px: int) -> NDArray[np.uint32]:
        """Events per pixel, (2, H, W): polarity 0, polarity 1."""


class CpuCaster:
    """Casts rays of one camera, and groups them by rows of the reference view."""

    def __init__(
        self, recording: Recording, view: ReferenceView, camera: int, *, packets: bool
    ) -> None:
        self._camera = recording.rig.cameras[camera], recording.rig.T_body_cam[camera]
        self._poses = knots(recording.trajectory, view.T_world_rv)
        self._view, self.packets = view, packets

    def __call__(self, events: Events) -> Rays:
        """Casts every event's ray into the reference view (paper, Alg. 1, line 3)."""
        camera, rho = self._view.camera, self._view.rho
        rays = rays_between(events, *self._camera, self._poses, camera, packets=self.packets)
        return grouped_by_rows(rays, float(rho[len(rho) // 2]), camera.height_px)

    def joined(self, pieces: Sequence[Rays]) -> Between:
        """Pieces copied into one, of which every stretch is a view."""
        whole, counts = Rays.joined(pieces), [piece.counts for piece in pieces]
        starts = np.r_[0, np.cumsum([count.rays for count in counts])]

        def between(first: int, last: int) -> Rays:
            if (first, last) == (0, len(counts)):
                return whole.in_planes(self._view.rho)
            start, stop = int(starts[first]), int(starts[last])
            part = whole.part(start, stop, RayCounts.total(counts[first:last]))
            return part.in_planes(self._view.rho)

        return between


class CpuProjector:
    """The compiled loops on all cores."""

    caster = CpuCaster

    def reading(
        self, recording: Recording, _windows: Sequence[Window]
    ) -> AbstractContextManager[Recording]:
        """The recording as it is: nothing is read ahead."""
        return nullcontext(recording)

    def received(self, events: Events) -> Events:
        """The events as they are."""
        return events

    def event_image(self, events: Events, width_px: int, height_px: int) -> NDArray[np.uint32]:
        """Events per pixel, (2, H, W): polarity 0, polarity 1."""
        cell = (events.p != 0).astype(np.intp)
        for size_px, place in ((height_px, events.y), (width_px, events.x)):
            cell *= size_px
            cell += place
        counts = np.bincount(cell, minlength=2 * height_px * width_px)
        return counts.astype(np.uint32).reshape(2, height_px, width_px)
