"""Statistics of events in windows of time and place: what tells two streams apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents

NAMES = (
    "rate", "ON share", "active pixels", "interval 10 %", "interval 50 %", "interval 90 %",
    "equal polarity in a row", "short intervals", "isolated events", "rate at edges",
    "spread in x", "spread in y",
)  # fmt: skip
_SHORT_US, _ALONE_US = 10_000, 10_000
_SAME_EDGE_US = 100_000
_FEW = 50
_GRID = 3


def window_features(
    events: Events, shape: tuple[int, int], span_us: tuple[int, int], windows: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Statistics, (N, F), of 3 x 3 parts of the sensor in each window, and their windows, (N,).

    Parts with fewer than 50 events are left out.
    """
    edges = np.linspace(span_us[0], span_us[1] + 1, windows + 1).astype(np.int64)
    height, width = shape
    rows, windows_of = [], []
    for k, (t0, t1) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
        inside = events.between(t0, t1)
        part = (inside.y.astype(int) * _GRID // height) * _GRID + inside.x.astype(
            int
        ) * _GRID // width
        for place in range(_GRID * _GRID):
            chosen = inside.take(part == place)
            if len(chosen) >= _FEW:
                rows.append(_features(chosen, shape, (t0, t1)))
                windows_of.append(k)
    return np.array(rows).reshape(-1, len(NAMES)), np.array(windows_of, np.int64)


def _features(events: Events, shape: tuple[int, int], span_us: tuple[int, int]) -> list[float]:
    pixels = PixelEvents.of(events, shape, span_us)
    gap_us, _, alike = pixels.gaps
    area = shape[0] * shape[1] / _GRID**2
    quantiles = (
        np.quantile(gap_us, (0.1, 0.5, 0.9)) if len(gap_us) else np.full(3, span_us[1] - span_us[0])
    )
    alone = isolated(events, shape)
    edge_hz = edge_rates_hz(events, shape, alone)
    return [
        float(np.log(len(events) / area / pixels.seconds)),
        float(events.p.mean()),
        float(np.log(np.count_nonzero(pixels.counts) / len(events))),
        *np.log(np.maximum(quantiles, 1)).tolist(),
        float(alike.mean()) if len(alike) else 0.5,
        float((gap_us < _SHORT_US).mean()) if len(gap_us) else 0.0,
        float(alone.mean()),
        float(np.log(np.median(edge_hz))) if len(edge_hz) else 0.0,
        float(events.x.std()) / shape[1],
        float(events.y.std()) / shape[0],
    ]


def edge_rates_hz(
    events: Events, shape: tuple[int, int], alone: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """How fast events follow each other at edges: (M,) inverse intervals, 1/s.

    Of two events in a row of a pixel, of one polarity and within 100 ms, of which the second is not
    `alone`, (N,): an edge that passes makes neighbours fire, noise does not.
    """
    pixel = events.y.astype(np.int64) * shape[1] + events.x
    order = np.argsort(pixel, kind="stable")
    pixel, t_us, on, edge = pixel[order], events.t_us[order], events.p[order], ~alone[order]
    gap_us = np.diff(t_us)
    same = (np.diff(pixel) == 0) & (on[1:] == on[:-1]) & edge[1:] & (gap_us < _SAME_EDGE_US)
    return np.asarray(1e6 / np.maximum(gap_us[same], 1), np.float64)


def isolated(events: Events, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(N,) whether none of an event's 8 neighbouring pixels was active within 10 ms before."""
    if not len(events):
        return np.zeros(0, np.bool_)
    bins = (events.t_us - events.t_us[0]) // _ALONE_US
    height, width = shape[0] + 2, shape[1] + 2
    place = (events.y.astype(np.int64) + 1) * width + events.x + 1
    cell = bins * (height * width) + place
    busy = np.unique(cell)
    near = np.zeros(len(events), np.bool_)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            for dt in (-1, 0):
                if dx or dy:
                    other = cell + dt * height * width + dy * width + dx
                    at = np.minimum(np.searchsorted(busy, other), len(busy) - 1)
                    near |= busy[at] == other
    return ~near
