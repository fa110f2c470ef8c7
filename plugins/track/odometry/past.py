"""Poses before the first map's stretch: earlier batches are tracked on that map, backwards in time.

A rig that hardly moves at first, or sees too little, has its first map late. What came before is
tracked as if time ran backwards, from the first motion to the first events, or as far as events and
map agree. However long that is, memory holds one stretch of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.track.odometry.batches import (
    COMPANY_US,
    LONGEST_US,
    Batch,
    Sizes,
    batch_before,
    never_fired,
    without_lone,
)
from eventsweep.plugins.track.odometry.motion import Motion
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.registration.fit import AGREES, Fit, Registration
from eventsweep.plugins.track.odometry.stream import Stream

Past = Callable[[int, int], Sequence[Events]]
"""The events of every camera with `t0_us <= t < t1_us`."""
Found = tuple[Motion, Fit, Status]
_STRETCH_US = 400_000


def earlier(
    past: Past, rig: Rig, registration: Registration, sizes: Sizes, first: Motion, ends_us: range
) -> list[Found]:
    """Motions before the `first`, in order of time, as far as the map goes.

    Args:
        past: gives the events.
        rig: the cameras.
        registration: what registers, with the map.
        sizes: numbers that follow from the sensor.
        first: a motion on that map.
        ends_us: where batches may end, falling down to the first event.
    """
    found: list[Found] = []
    here = first
    for batch in _falling(past, rig, sizes, first.t_us, ends_us):
        if len(batch) < sizes.still:
            here = here.held(batch.t_us)
            found.append((here, Fit(), Status.STILL))
            continue
        here, fit = registration(batch.events, here.at(batch.t_us))
        if not fit.is_good(AGREES):
            break
        found.append((here, fit, Status.TRACKING))
    return found[::-1]


def _falling(past: Past, rig: Rig, sizes: Sizes, before_us: int, ends_us: range) -> Iterator[Batch]:
    """Batches earlier than `before_us`, the last one first; few events of a short time are none."""
    since_us, count = ends_us.stop, max(1, _STRETCH_US // -ends_us.step)
    for k in range(0, len(ends_us), count):
        ends = ends_us[k : k + count]
        streams = _streams(past, rig, max(since_us, ends[-1] - LONGEST_US), ends[0])
        for end_us in ends:
            batch = batch_before(streams, end_us, sizes.events, since_us)
            is_short = end_us - since_us < LONGEST_US and len(batch) < sizes.still
            if batch.t_us < before_us and not is_short:
                before_us = batch.t_us
                yield batch


def _streams(past: Past, rig: Rig, first_us: int, last_us: int) -> list[Stream]:
    """Events that have company, of every camera."""
    streams = [Stream() for _ in rig.cameras]
    packets = past(first_us - COMPANY_US, last_us)
    for stream, camera, packet in zip(streams, rig.cameras, packets, strict=True):
        stream.push(without_lone(packet, never_fired(camera)))
        stream.drop_before(first_us)
    return streams
