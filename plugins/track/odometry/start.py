"""The first map and the first poses: static stereo, then maps on the poses that it gives.

Static stereo knows no motion, so some of its points are wrong. It is used from the middle of the
first stretch of events, forwards and backwards in time; then the whole stretch is tracked and
mapped in turns: forwards, smoothed, adjusted with the depths of what it saw (`bundle`), and mapped
on those poses. Nothing of the stereo map remains.

A stretch in which the rig has hardly moved has no parallax to map: it grows until it has, up to
`LONGEST_START_US`, so that its poses are found in the end.

What came before is tracked on the first map as if time ran backwards, from the first motion to the
first events, or as far as events and map agree. However long that is, memory holds one stretch of
it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.windows import Window
from eventsweep.plugins.track.odometry.batches import (
    COMPANY_US,
    LONGEST_US,
    Batch,
    Sizes,
    batch_before,
    never_fired,
    shows_edges,
    without_lone,
)
from eventsweep.plugins.track.odometry.maps import points_of
from eventsweep.plugins.track.odometry.motion import Motion, smoothed_motions, trajectory_of
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.registration.bundle import adjusted
from eventsweep.plugins.track.odometry.registration.fit import (
    AGREES,
    LEAST_INLIERS,
    Fit,
    Registration,
)
from eventsweep.plugins.track.odometry.stream import Arrived, Stream

Matrix = NDArray[np.float64]
Past = Callable[[int, int], Sequence[Events]]
"""The events of every camera with `t0_us <= t < t1_us`."""
Found = tuple[Motion, Fit, Status]
START_US, LONGEST_START_US = 200_000, 400_000
LEAST_POINTS = 500
_STEREO = "SGM/ts"
_ROUNDS, _DOUBTFUL_ROUNDS = 2, 4  # of mapping the stretch
_EVERY = 2  # batches, one pose takes part in them
_SETTLING = 3  # registrations of the first batch, whose twist nothing predicts
_SLOW, _SLOWEST, _MOST_LESS = 0.1, 0.03, 0.97  # of the usual reach; of what agrees
_ALIKE = 0.5  # of a way, that another differs by
_HEAD = 1.0  # reach of a body that begins slowly, and of all where something is near
_LEAST_SHARE = 0.6  # of the batches, around the middle one
_STRETCH_US = 400_000
_FEW_FIT = "only {} of {} batches fit the first map"


def begin(
    arrived: Arrived, batches: Sequence[Batch], registration: Registration, sizes: Sizes,
    config: MapperConfig, known: tuple[Motion, Matrix] | None = None, reach: float = 1.0,
) -> tuple[list[Motion], list[Fit], Matrix] | str:  # fmt: skip
    """Motions at the batches, how well each fits, and the (N, 3) points of the map.

    Args:
        arrived: events; its poses are replaced.
        batches: those of the first stretch, times rising.
        registration: what registers; in the end it uses the map that is returned.
        sizes: numbers that follow from the sensor.
        config: of the maps.
        known: a pose and the points of a map, instead of static stereo; it begins there.
        reach: of motions.

    Returns:
        A reason where there is no beginning yet.
    """
    times = np.array([batch.t_us for batch in batches])
    k_start = len(batches) // 2 if known is None else int(np.abs(times - known[0].t_us).argmin())
    middle = batches[k_start]
    try:
        start, points = _stereo(arrived, middle, config, reach) if known is None else known
    except InputError as error:
        return str(error)
    if len(points) < LEAST_POINTS:
        return f"the first map has {len(points)} points: needs {LEAST_POINTS}"
    if known is not None:
        found = _tracked(batches, k_start, 1, start, points, registration, sizes)
        return found if isinstance(found, str) else (*found, points)
    begun = _slow_or_fast(batches, k_start, _EVERY, start, points, registration, sizes)
    if isinstance(begun, str):
        return begun
    found, is_observable = begun[:2], begun[2]
    if found[0][0].reach < reach:  # as fast as what passed may be, it would be followed after all
        reach = _HEAD
    for _ in range(_ROUNDS if is_observable else _DOUBTFUL_ROUNDS):
        found = _followed(batches[::_EVERY], found[0][0], reach, points, registration, sizes)
        if isinstance(found, str):
            return found
        if is_observable:
            found = _adjusted(batches, found[0], registration, arrived.rig), found[1]
        points = _mapped(arrived, found[0], config)
        if len(points) < LEAST_POINTS:
            return f"the map of the first poses has {len(points)} points: needs {LEAST_POINTS}"
    found = _followed(batches, found[0][0], reach, points, registration, sizes)
    return found if isinstance(found, str) else (*found, points)


def _slow_or_fast(
    batches: Sequence[Batch], k_start: int, every: int, start: Motion, points: Matrix,
    registration: Registration, sizes: Sizes,
) -> tuple[list[Motion], list[Fit], bool] | str:  # fmt: skip
    """Tracks as `_tracked` does, by any expectation; as a slow body where that agrees as well.

    Before a far wall the rig's own way hardly shows: a body that passes nearby agrees with a turn
    and a way of its own, and would be followed as fast as it goes. Of motions that explain about as
    much a slower one is believed. If a slow one follows such a body, too, one nearly at rest may
    agree better.

    Returns:
        Motions, how well each fits, and whether the way is observable: all is near, or it is about
        the same whatever was expected.
    """

    def by(share: float) -> tuple[list[Motion], list[Fit]] | str:
        motion = Motion.unknown(start.t_us, start.T_world_body, share * start.reach)
        return _tracked(batches, k_start, every, motion, points, registration, sizes)

    is_near, fast, slow = start.reach <= _HEAD, by(1.0), by(_SLOW)
    if isinstance(fast, str) or isinstance(slow, str):
        found = slow if isinstance(fast, str) else fast
        return found if isinstance(found, str) else (*found, is_near)
    is_observable = is_near or _are_alike(_way(fast[0]), _way(slow[0]))
    if not is_observable and not _agrees_as_well(slow, fast):
        slowest = by(_SLOWEST)
        slow = slow if isinstance(slowest, str) else slowest
    return *(slow if _agrees_as_well(slow, fast) else fast), is_observable


def _agrees_as_well(
    found: tuple[list[Motion], list[Fit]], other: tuple[list[Motion], list[Fit]]
) -> bool:
    """Whether motions explain about as much as others."""
    return _agreement(found[1]) > _MOST_LESS * _agreement(other[1])


def _way(motions: Sequence[Motion]) -> Matrix:
    """From the first motion to the last one, (3,) m."""
    way: Matrix = motions[-1].T_world_body[:3, 3] - motions[0].T_world_body[:3, 3]
    return way


def _are_alike(way: Matrix, other: Matrix) -> bool:
    """Whether two ways differ by less than half of the longer one."""
    off_m, *lengths_m = (float(np.linalg.norm(each)) for each in (way - other, way, other))
    return off_m < _ALIKE * max(lengths_m)


def _agreement(fits: Sequence[Fit]) -> float:
    """Residuals near zero, of all batches."""
    return sum(fit.closeness * fit.inliers for fit in fits)


def _tracked(
    batches: Sequence[Batch], k_start: int, every: int, start: Motion, points: Matrix,
    registration: Registration, sizes: Sizes,
) -> tuple[list[Motion], list[Fit]] | str:  # fmt: skip
    """Tracks each so many batches on a map, from `k_start` both ways; a reason where few fit."""
    some = batches[k_start % every :: every]
    registration.use_map(points, few(points, sizes))
    motions, fits = _both_ways(some, k_start // every, start, registration)
    if len(motions) < _LEAST_SHARE * len(some):
        return _FEW_FIT.format(len(motions), len(some))
    return motions, fits


def _followed(
    batches: Sequence[Batch], first: Motion, reach: float, points: Matrix,
    registration: Registration, sizes: Sizes,
) -> tuple[list[Motion], list[Fit]] | str:  # fmt: skip
    """Tracks batches on a map forwards from near the `first` motion, and smooths what that gives.

    A map on poses that err shows the same error, and the next poses are found on it. A batch hardly
    sees some of them, as a turn about one axis with a shift along another: unless its neighbours in
    time decide those, they grow whenever the stretch is mapped again. So does a
    motion that follows a moving body: lines that drift are left out.
    """
    registration.use_map(points, few(points, sizes))
    here = replace(Motion.near(first.t_us, first.T_world_body, reach), twist=first.twist)
    motions: list[Motion] = []
    fits: list[Fit] = []
    for batch in batches:
        motion, fit = registration.nearby(batch.events, here.at(batch.t_us), judged=True)
        if fit.inliers >= LEAST_INLIERS:
            here = motion
            motions, fits = [*motions, motion], [*fits, fit]
        elif motions:
            break
    if len(motions) < _LEAST_SHARE * len(batches):
        return _FEW_FIT.format(len(motions), len(batches))
    return [motion for motion in smoothed_motions(motions) if motion is not None], fits


def few(points: Matrix, sizes: Sizes) -> Matrix:
    """Of points in any order as many as take part in distances."""
    return np.ascontiguousarray(points[:: max(1, len(points) // sizes.distances)])


def _stereo(
    arrived: Arrived, middle: Batch, config: MapperConfig, reach: float
) -> tuple[Motion, Matrix]:
    """The map of a rig that stands at the origin, at the time of a batch.

    Of all events: pixels whose newest one is left out differ between the cameras.
    """
    arrived = arrived.whole()
    first_us = min(arrived.event_span_us(k)[0] for k in range(len(arrived.rig)))
    standing = np.array([[0, 0, 0, 1.0]] * 2)
    arrived.poses = Trajectory(np.array([first_us, middle.t_us + 1]), np.zeros((2, 3)), standing)
    window = Window(first_us, middle.t_us, middle.t_us, (0,) * len(arrived.rig))
    names = "width_px", "height_px", "focal_px", "focal_y_px"
    of_camera = dict.fromkeys([f"view_{name}" for name in names])
    stereo = config.model_copy(update={"methods": (_STEREO,), **of_camera})
    points = points_of(map_window(arrived, stereo, window=window).depth_maps[_STEREO])
    return Motion.unknown(middle.t_us, np.eye(4), reach), points


def _adjusted(
    batches: Sequence[Batch], motions: Sequence[Motion], registration: Registration, rig: Rig
) -> list[Motion]:
    """Motions on a map whose points may lie nearer or farther, seen from the middle motion.

    Not where all is far and the way follows what was expected: something may pass there, and its
    depths would bend so that it stands.
    """
    at = {batch.t_us: batch for batch in batches}
    middle = motions[len(motions) // 2].T_world_body @ rig.T_body_cam[0]
    return adjusted([at[m.t_us] for m in motions], motions, registration, middle[:3, 3])


def _mapped(arrived: Arrived, motions: Sequence[Motion], config: MapperConfig) -> Matrix:
    """The points of the map of the stretch on the poses of motions."""
    arrived.poses = trajectory_of(motions)
    first_us, last_us = arrived.poses.span_us
    window = Window(first_us, last_us, (first_us + last_us) // 2, (0,) * len(arrived.rig))
    return points_of(map_window(arrived, config, window=window).depth_maps[config.methods[0]])


def _both_ways(
    batches: Sequence[Batch], k: int, start: Motion, registration: Registration
) -> tuple[list[Motion], list[Fit]]:
    """Tracks from batch `k` to both ends, as far as the map goes."""
    fit = Fit()
    for _ in range(_SETTLING):
        settled, fit = registration(batches[k].events, start)
        unknown = Motion.unknown(start.t_us, settled.T_world_body, start.reach)
        start = replace(unknown, twist=settled.twist)
    motions, fits = [settled], [fit]
    for batch in batches[k + 1 :]:
        motion, fit = registration(batch.events, motions[-1].at(batch.t_us))
        if fit.inliers < LEAST_INLIERS:
            break
        motions, fits = [*motions, motion], [*fits, fit]
    for batch in reversed(batches[:k]):
        motion, fit = registration(batch.events, motions[0].at(batch.t_us))
        if fit.inliers < LEAST_INLIERS:
            break
        motions, fits = [motion, *motions], [fit, *fits]
    return motions, fits


def earlier(
    past: Past, rig: Rig, registration: Registration, sizes: Sizes, first: Motion, ends_us: range,
    status: Status,
) -> list[Found]:  # fmt: skip
    """Motions before the `first`, in order of time, as far as the map goes.

    Args:
        past: gives the events.
        rig: the cameras.
        registration: what registers, with the map.
        sizes: numbers that follow from the sensor.
        first: a motion on that map.
        ends_us: where batches may end, falling down to the first event.
        status: of motions that agree with the map.
    """
    motions: list[Found] = []
    here = first
    for batch in _falling(past, rig, sizes, first.t_us, ends_us):
        if len(batch) < sizes.still:
            here = here.held(batch.t_us)
            motions.append((here, Fit(), Status.STILL))
            continue
        here, fit = registration.nearby(batch.events, here.at(batch.t_us))
        if not (fit.is_good(AGREES) and shows_edges(batch)):
            break
        motions.append((here, fit, status))
    return motions[::-1]


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
