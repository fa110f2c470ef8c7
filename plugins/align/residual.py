"""How far edges of frames and of events lie apart, in pixels of the frame camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.plugins.align.carry import event_rho
from eventsweep.plugins.align.edges import Edges, find_edges, match
from eventsweep.plugins.align.rig import Setup
from eventsweep.plugins.align.views import Array, View, as_large, bearings

SPAN_US = 10_000
"""Events so long before and after a frame are compared with it, µs."""
GATE_PX = 3.0
_MOST_EVENTS = 60_000
_LEAST_EVENTS = 3
_RANGES = 4
_FLOW_US = 500.0
_AMBIGUOUS_PX = 0.25
"""How far apart in a frame an event of two surfaces may lie: as much as pixels round its place."""


class Sample(NamedTuple):
    """A frame's edges and the events around its time.

    Attributes:
        number: the frame's.
        edges: of the frame.
        points: (N, 3) homogeneous points of the world that made the events.
        rho: (N,) their scale: inverse depth in the event camera, 1/m.
        brighter: (N,) polarity.
    """

    number: int
    edges: Edges
    points: Array
    rho: Array
    brighter: NDArray[np.bool_]


class Apart(NamedTuple):
    """How far edges lie apart.

    Attributes:
        off_px: (K,) distance of each edge pixel from the mean of its events, signed, px.
        depth_m: (K,) depth in the frame camera.
        matched: share of the events with an edge within `GATE_PX`.
    """

    off_px: Array
    depth_m: Array
    matched: float

    def table(self) -> list[dict[str, float | int]]:
        """A row for all edges, then one for each quarter of them, from near to far."""
        rows = [self._row(np.ones(len(self.off_px), bool))]
        if len(self.off_px) >= 4 * _RANGES:
            ends = np.quantile(self.depth_m, np.linspace(0, 1, _RANGES + 1))
            which = np.clip(np.searchsorted(ends, self.depth_m, "right") - 1, 0, _RANGES - 1)
            rows += [self._row(which == k) for k in range(_RANGES) if (which == k).any()]
        return rows

    def _row(self, some: NDArray[np.bool_]) -> dict[str, float | int]:
        off_px, depth_m = np.abs(self.off_px[some]), self.depth_m[some]
        return {
            "depth_from_m": float(depth_m.min()), "depth_to_m": float(depth_m.max()),
            "edges": int(some.sum()), "median_px": float(np.median(off_px)),
            "p95_px": float(np.percentile(off_px, 95)),
        }  # fmt: skip


def samples(setup: Setup, indices: Sequence[int], progress: Progress = silent) -> list[Sample]:
    """Edges and events of some frames.

    Raises:
        InputError: around none of them is there an event of known depth away from silhouettes.
    """
    found = []
    for done, index in enumerate(indices):
        sample = _sample(setup, index)
        found += [] if sample is None else [sample]
        progress("compare", done + 1, len(indices))
    if not found:
        raise InputError(
            f"{setup.recording.name}: no event that is surely of one depth within "
            f"{SPAN_US / 1000:g} ms of a frame"
        )
    return found


def _sample(setup: Setup, index: int) -> Sample | None:
    assert setup.frames is not None
    t_us, (first_us, last_us) = setup.frame_time_us(index), setup.recording.trajectory.span_us
    t0_us, t1_us = max(round(t_us) - SPAN_US, first_us), min(round(t_us) + SPAN_US, last_us)
    parts = []
    for a_us, b_us, depths in setup.slices(t0_us, t1_us):
        events = setup.recording.events(setup.events, a_us, b_us)
        rho, _, farther = event_rho(events, depths)
        points = _points(setup, events, rho)
        instead = _points(setup, events, farther), farther
        good = (rho >= 0) & ~_ambiguous(setup.frame_view(index), (points, rho), instead)
        parts.append((points[good], rho[good], events.p[good] == 1))
    points, rho, brighter = (np.concatenate(column) for column in zip(*parts, strict=True))
    if not len(rho):
        return None
    some = slice(None, None, -(-len(rho) // _MOST_EVENTS))
    image = setup.frames.photo(index).image.astype(np.float32)
    edges = find_edges(as_large(image, setup.frames.camera, setup.event_camera.camera))
    return Sample(index, edges, points[some], rho[some], brighter[some])


def _ambiguous(
    view: View, one: tuple[Array, Array], other: tuple[Array, Array]
) -> NDArray[np.bool_]:
    """(N,) whether a view has points (N, 3) and (N,) of one surface far from those of another.

    Beside a silhouette texture of the background makes events too. Where the frame camera sees more
    of the background, on one side of an object, its edges would pull them along the baseline.
    Events on both sides of a silhouette count: the outer half of a rim's alone would shift it.
    """
    one_px, other_px = (view.seen(points, np.maximum(rho, 0.0))[0] for points, rho in (one, other))
    return np.asarray(np.linalg.norm(one_px - other_px, axis=-1) > _AMBIGUOUS_PX)


def _points(setup: Setup, events: Events, rho: Array) -> Array:
    """(N, 3) homogeneous points of the world, each seen from where the camera was at its time."""
    mounted = setup.event_camera
    T = setup.recording.trajectory.at(events.t_us) @ mounted.T_body_cam
    bearing = bearings(mounted.camera)[events.y, events.x]
    rays = np.concatenate([bearing, np.ones((len(events), 1))], axis=-1)
    turned = np.einsum("nij,nj->ni", T[:, :3, :3], rays)
    return np.asarray(turned + np.maximum(rho, 0)[:, None] * T[:, :3, 3], np.float64)


def places(setup: Setup, sample: Sample) -> tuple[Array, Array, Array]:
    """Where a frame's camera has the events' points: (N, 2) px, (N, 2) px/ms, (N,) 1/m."""
    last_us = setup.recording.trajectory.span_us[1]
    step_us = _FLOW_US if setup.frame_time_us(sample.number) + _FLOW_US <= last_us else -_FLOW_US
    later = setup.corrected(replace(setup.correction, late_us=setup.correction.late_us + step_us))
    uv_px, rho = setup.frame_view(sample.number).seen(sample.points, sample.rho)
    there_px, _ = later.frame_view(sample.number).seen(sample.points, sample.rho)
    return uv_px, (there_px - uv_px) * 1000 / step_us, rho


def apart(setup: Setup, found: Sequence[Sample]) -> Apart:
    """Compares edge by edge.

    Raises:
        InputError: no edge has enough events.
    """
    off, deep, matched, total = [], [], 0, 0
    for sample in found:
        uv_px, moving_px, rho = places(setup, sample)
        pairs = match(sample.edges, uv_px, moving_px, sample.brighter, GATE_PX)
        count = np.bincount(pairs.edges, minlength=len(sample.edges.uv_px))
        mean_px = _mean(pairs.edges, pairs.off_px, count)
        good = count >= _LEAST_EVENTS
        off.append(mean_px[good])
        with np.errstate(divide="ignore"):
            deep.append(1 / _mean(pairs.edges, rho[pairs.points], count)[good])
        matched, total = matched + len(pairs.points), total + len(rho)
    off_px, depth_m = np.concatenate(off), np.concatenate(deep)
    if not len(off_px):
        raise InputError(
            f"{setup.recording.name}: no edge of a frame has events within {GATE_PX:g} px: check "
            "calibration, clocks and depth"
        )
    return Apart(off_px, depth_m, matched / total)


def _mean(which: NDArray[np.int64], values: Array, count: NDArray[np.int64]) -> Array:
    total = np.bincount(which, values, minlength=len(count))
    return np.asarray(total / np.maximum(count, 1), np.float64)
