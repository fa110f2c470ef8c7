"""One frame, one depth map or one stretch of events in the target's pixels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.plugins.align.depths import Depths
from eventsweep.plugins.align.rig import Setup
from eventsweep.plugins.align.views import (
    SAME_SURFACE,
    Array,
    View,
    bearings,
    known_depth_m,
    shown_in,
)
from eventsweep.plugins.align.views_kernels import OCCLUDED, OUTSIDE, SEEN, UNKNOWN, look_up


class AlignedFrame(NamedTuple):
    """A frame in the target's pixels.

    Attributes:
        t_us: the time whose view this is, µs.
        image: (H, W) float32 grey levels, 0 to 255; 0 where nothing is seen.
        mask: (H, W) uint8, see `views_kernels`.
        depth_m: (H, W) float32 z-depth, NaN where unknown.
    """

    t_us: int
    image: NDArray[np.float32]
    mask: NDArray[np.uint8]
    depth_m: NDArray[np.float32]


class AlignedEvents(NamedTuple):
    """Events in the target's pixels, as many as are seen there.

    Attributes:
        events: pixels rounded; times and polarities as they were.
        xy_px: (N, 2) float32 pixels.
        depth_m: (N,) float32 z-depth in the target.
        unsure: (N,) uint8, 1 beside a silhouette, where the farther surface may have made it.
        lost: how many events have no depth, fall outside, are hidden there.
    """

    events: Events
    xy_px: NDArray[np.float32]
    depth_m: NDArray[np.float32]
    unsure: NDArray[np.uint8]
    lost: tuple[int, int, int]


def aligned_frame(setup: Setup, index: int, t_us: float | None = None) -> AlignedFrame:
    """A frame as the target would see it at a time, by default the frame's own."""
    assert setup.frames is not None
    picture = setup.frames.photo(index).image.astype(np.float32)
    taken_us = setup.frame_time_us(index)
    at_us = taken_us if t_us is None else t_us
    view = setup.view(setup.target, at_us)
    rho = setup.carried(view, at_us)
    if t_us is None and setup.target.name == setup.frames.name:
        return AlignedFrame(
            round(at_us), picture, np.full(view.shape, SEEN, np.uint8), known_depth_m(rho)
        )
    taken = setup.frame_view(index)
    image, mask = shown_in(view, rho, picture, taken, setup.carried(taken, taken_us))
    return AlignedFrame(round(at_us), image, mask, known_depth_m(rho))


def aligned_events(
    setup: Setup, first_us: int, last_us: int
) -> Iterator[tuple[int, AlignedEvents]]:
    """The event camera's events of a span as the target would see them at their own times.

    Both cameras sit on one body, so that poses only carry depth.

    Yields:
        The end of each slice, µs, and its events.
    """
    source = setup.event_camera
    T_target_event = se3.inverse(setup.target.T_body_cam) @ source.T_body_cam
    at_event = View(source.camera, T_target_event)  # in a world that is the target
    at_target = View(setup.target.camera, np.eye(4))
    for t0_us, t1_us, depths in setup.slices(first_us, last_us):
        events = setup.recording.events(setup.events, t0_us, t1_us)
        rho, unsure, _ = event_rho(events, depths)
        middle_us = (t0_us + t1_us) / 2
        hides = setup.carried(setup.view(setup.target, middle_us), middle_us)
        bearing = bearings(source.camera)[events.y, events.x]
        known = np.maximum(rho, 0.0)
        uv_px, seen_rho = at_target.seen(at_event.points(bearing, known), known)
        seen_rho = np.where(rho >= 0, np.maximum(seen_rho, 0.0), -1.0)
        yield t1_us, _seen(events, uv_px, seen_rho, unsure, hides)


def event_rho(events: Events, depths: Depths) -> tuple[Array, NDArray[np.bool_], Array]:
    """Inverse depth of each event: the nearest surface of its pixel and those around it.

    An edge that passes belongs to the nearer of its two surfaces. On one slanted surface neighbours
    are nearer as well, but those opposite are as much farther.

    Returns:
        (N,) inverse depth, 1/m, below 0 where unknown; (N,) whether its own pixel sees a farther
        surface, whose texture may have made the event instead; and (N,) inverse depth of the
        farther surface, on either side of a silhouette, the same as the first elsewhere.
    """
    rho, around = depths[0][0], np.ones((3, 3), np.uint8)
    near, far = cv2.dilate(rho, around), cv2.erode(np.where(rho < 0, rho.max(), rho), around)
    above, below = near - rho, rho - far
    is_other = above > SAME_SURFACE * rho + 2 * below
    is_rim = (below > SAME_SURFACE * far + 2 * above) & (rho >= 0)
    mine = np.where(is_other, near, rho)
    farther = np.where(is_rim, far, np.where(rho >= 0, rho, mine))
    return mine[events.y, events.x], is_other[events.y, events.x], farther[events.y, events.x]


def _seen(
    events: Events, uv_px: Array, rho: Array, unsure: NDArray[np.bool_], hides: Array
) -> AlignedEvents:
    value, mask = np.empty(len(events), np.float32), np.empty(len(events), np.uint8)
    look_up(uv_px, rho, hides, np.zeros(hides.shape, np.float32), SAME_SURFACE, value, mask)
    good = mask == SEEN
    xy_px, deep = uv_px[good], rho[good]
    x, y = np.rint(xy_px).astype(np.uint16).T
    lost = [int(np.count_nonzero(mask == kind)) for kind in (UNKNOWN, OUTSIDE, OCCLUDED)]
    with np.errstate(divide="ignore"):
        depth_m = (1 / deep).astype(np.float32)
    moved = Events(
        np.ascontiguousarray(x), np.ascontiguousarray(y), events.t_us[good], events.p[good]
    )
    doubt = unsure[good].astype(np.uint8)
    three = lost[0], lost[1], lost[2]
    return AlignedEvents(moved, xy_px.astype(np.float32), depth_m, doubt, three)
