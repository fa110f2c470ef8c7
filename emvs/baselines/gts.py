"""Event-by-event stereo (GTS): pairs that coincide in row, time and motion, triangulated.

Ieng et al., *Neuromorphic Event-Based Generalized Time-Based Stereovision*, Frontiers in
Neuroscience 2018: the energy of a pair sums the distance from the epipolar line, the difference in
time and the difference in motion; the fourth term, grey levels, needs a sensor that measures them.
It is the class of methods that ray density fusion argues against, since it must decide on each pair
of events by itself.

A plane through the last event times around an event has a slope in µs per pixel, whose inverse is
the normal flow (Benosman et al., *Event-based visual flow*, TNNLS 2014).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.baselines.gts_kernels import NEVER, fit, search
from eventsweep.emvs.baselines.rectification import Rectified, depth_map, see
from eventsweep.emvs.baselines.sgm import disparity_range_px
from eventsweep.emvs.config import Coincidence, GtsParameters, MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.reference_view import ReferenceView
from eventsweep.emvs.utils.runtime import in_threads
from eventsweep.emvs.windows import Window

Float64s = NDArray[np.float64]
Indices = NDArray[np.int64]


def estimate(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig
) -> DepthMap:
    """Depth from pairs of events of the whole window (`GTS/events`).

    Each pixel of the view takes its nearest point. Confidence is `1 / (1 + energy)`, 0..1.

    Raises:
        InputError: a rig or depth range that cannot be matched, or no pair in the window.
    """
    stereo = Rectified.of(recording.rig)
    range_px = disparity_range_px(stereo, view)
    left, right = (_stream(side, stereo, recording, window, config.gts) for side in (0, 1))
    i, j, energy = pairs(left, right, range_px, config.gts.coincidence)
    disparity_px = left.uv_px[i, 0] - right.uv_px[j, 0]
    good = disparity_px > 0
    if not good.any():
        raise InputError(
            f"GTS/events: no events match among the {len(left.t_us)} and {len(right.t_us)} "
            f"events from {window.t0_us} to {window.t1_us} µs: choose a longer duration_s, or "
            "put both cameras on one clock"
        )
    i, disparity_px, energy = i[good], disparity_px[good], energy[good]
    points_body = stereo.points_body(left.uv_px[i], disparity_px)
    T_world_body = recording.trajectory.at(left.t_us[i])
    points_world = se3.transform_each(T_world_body, points_body)
    seen = see(points_world, 1 / (1 + energy), view)
    return depth_map("GTS/events", seen.depth_m, seen.value, view, config)


@dataclass(frozen=True, eq=False)
class Stream:
    """Events of one camera in its rectified view.

    Attributes:
        uv_px: (N, 2) columns and rows.
        t_us: (N,) int64 sorted times, µs.
        p: (N,) polarities.
        slope: (N, 2) time slopes, µs/px; events with NaN match nothing.
    """

    uv_px: Float64s
    t_us: Indices
    p: NDArray[np.uint8]
    slope: Float64s


def _stream(
    side: int, stereo: Rectified, recording: Recording, window: Window, parameters: GtsParameters
) -> Stream:
    """Events of one camera with their rectified places and their motion."""
    events = recording.events(stereo.cameras[side], window.t0_us, window.t1_us)
    uv_px = stereo.events_px(side, events).astype(np.float64)
    size_px = stereo.camera.width_px, stereo.camera.height_px
    pixels = np.rint(np.nan_to_num(uv_px, nan=-1.0)).astype(np.int64)
    inside = np.isfinite(uv_px).all(axis=1) & (pixels >= 0).all(axis=1) & (pixels < size_px).all(1)
    pixels[~inside] = -1
    since_us = events.t_us - min(window.t0_us, 0)
    slope = time_slopes(
        pixels, since_us, events.p, size_px, parameters.radius_px, round(parameters.memory_s * 1e6)
    )
    return Stream(uv_px, events.t_us, events.p, slope)


def time_slopes(
    pixels: NDArray[np.int64], t_us: NDArray[np.int64], p: NDArray[np.uint8],
    size_px: tuple[int, int], radius_px: int, memory_us: int,
) -> Float64s:  # fmt: skip
    """(N, 2) slopes, µs/px, of the last event times around each event, of its own polarity.

    `pixels` are (N, 2) columns and rows, columns negative for events that are left out; `t_us` are
    sorted and 0 or more. Neighbours lie within `radius_px` and are no older than `memory_us`; where
    too few of them fired, the slope is NaN.
    """
    last = np.full((2, size_px[1], size_px[0]), NEVER, np.int64)
    out = np.empty((len(t_us), 2))
    fit(pixels, t_us, p, radius_px, memory_us, last, out)
    return out


def pairs(
    left: Stream, right: Stream, range_px: tuple[float, float], settings: Coincidence
) -> tuple[Indices, Indices, Float64s]:
    """Events that choose each other: (K,) indices in `left` and `right`, and (K,) energies."""
    low, high = range_px
    one, other = _Rows.of(left), _Rows.of(right)
    to_right, energy = _best(one, other, low, high, settings)
    to_left, _ = _best(other, one, -high, -low, settings)
    mine = np.flatnonzero(to_right >= 0)
    mutual = mine[to_left[to_right[mine]] == mine]
    i, j = one.index[mutual], other.index[to_right[mutual]]
    order = np.argsort(i)
    return i[order], j[order], energy[mutual][order]


@dataclass(frozen=True, eq=False)
class _Rows:
    """The events of a stream that can match, sorted by polarity, row and time.

    Those that are compared lie beside each other in memory: fetched from all over it, they took
    most of the time of long windows.

    Attributes:
        index: (K,) places in the stream.
        start: (2, rows + 1) where each row of each polarity begins.
        p, uv_px, t_us, slope: (K, ...) of the stream.
    """

    index: Indices
    start: Indices
    p: NDArray[np.uint8]
    uv_px: Float64s
    t_us: Indices
    slope: Float64s

    @classmethod
    def of(cls, stream: Stream) -> _Rows:
        known = np.isfinite(stream.uv_px).all(axis=1) & ~np.isnan(stream.slope[:, 0])
        index = np.flatnonzero(known)
        row = np.rint(stream.uv_px[index, 1]).astype(np.int64)
        seen = row >= 0
        index, row = index[seen], row[seen]
        rows = int(row.max(initial=0)) + 1
        key = stream.p[index] * np.int64(rows) + row
        order = np.argsort(key, kind="stable")
        index, key = index[order], key[order]
        start = np.searchsorted(key, np.arange(2)[:, None] * rows + np.arange(rows + 1))
        of = (stream.p, stream.uv_px, stream.t_us, stream.slope)
        return cls(index, start, *(values[index] for values in of))


def _best(
    rows: _Rows, other: _Rows, low: float, high: float, settings: Coincidence
) -> tuple[Indices, Float64s]:
    """For each event of `rows`, the best of `other` with `low <= column difference <= high`."""
    out, energy = np.empty(len(rows.t_us), np.int64), np.empty(len(rows.t_us))
    widths = settings.row_px, settings.time_us, settings.motion, settings.most_energy
    in_threads(
        search, len(rows.t_us), rows.p, rows.uv_px, rows.t_us, rows.slope, other.start,
        other.uv_px, other.t_us, other.slope, low, high, widths, out, energy,
    )  # fmt: skip
    return out, energy
