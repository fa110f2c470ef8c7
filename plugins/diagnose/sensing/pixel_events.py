"""Events of one camera sorted by pixel, and what needs nothing else: intervals and quiet places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.hot_pixels import hot_mask

TILE_PX = 8
"""Pixels are drawn again in tiles of this size: neighbours see the same edges."""
HOT_RATIO = 10.0
_QUIET_US, _QUIET_PX = 10_000, 2
_SAME_EDGE_US, _ALONE_US = 100_000, 10_000
# Where frames lead one to expect more, nothing is quiet.
_SLOW_HZ = 3.0


@dataclass(frozen=True)
class PixelEvents:
    """Events in order of pixel, then of time.

    Attributes:
        shape: rows and columns of the sensor.
        span_us: first and last instant.
        pixel: (N,) int64 raster index.
        t_us: (N,) int64 times, µs.
        on: (N,) bool, brighter.
    """

    shape: tuple[int, int]
    span_us: tuple[int, int]
    pixel: NDArray[np.int64]
    t_us: NDArray[np.int64]
    on: NDArray[np.bool_]

    @classmethod
    def of(cls, events: Events, shape: tuple[int, int], span_us: tuple[int, int]) -> PixelEvents:
        """Sorts a stretch of one camera's events."""
        pixel = events.y.astype(np.int64) * shape[1] + events.x
        order = np.argsort(pixel, kind="stable")
        return cls(shape, span_us, pixel[order], events.t_us[order], events.p[order] > 0)

    def __len__(self) -> int:
        return len(self.t_us)

    @property
    def seconds(self) -> float:
        """Length of the stretch, s."""
        return (self.span_us[1] - self.span_us[0]) * 1e-6

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """(H, W) events per pixel."""
        number = self.shape[0] * self.shape[1]
        return np.bincount(self.pixel, minlength=number).reshape(self.shape)

    @cached_property
    def hot(self) -> NDArray[np.bool_]:
        """(H, W) pixels that send far more than what surrounds them."""
        return hot_mask(self.counts, HOT_RATIO)

    @cached_property
    def tile(self) -> NDArray[np.int64]:
        """(P,) the tile of each pixel."""
        height, width = self.shape
        columns = -(-width // TILE_PX)
        rows, across = np.arange(height) // TILE_PX, np.arange(width) // TILE_PX
        return (rows[:, None] * columns + across).ravel()

    @property
    def tiles(self) -> int:
        """How many tiles there are."""
        return int(self.tile[-1]) + 1

    @cached_property
    def gaps(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Of two events in a row of a pixel: time between, µs, pixel, whether polarity is equal."""
        same = np.diff(self.pixel) == 0
        gap_us = np.diff(self.t_us)[same]
        return gap_us, self.pixel[1:][same], (self.on[1:] == self.on[:-1])[same]

    @cached_property
    def alone(self) -> NDArray[np.bool_]:
        """(N,) whether none of an event's 8 neighbouring pixels was active within 10 ms before."""
        if not len(self):
            return np.zeros(0, np.bool_)
        height, width = self.shape[0] + 2, self.shape[1] + 2
        rows, columns = np.divmod(self.pixel, self.shape[1])
        bins = (self.t_us - self.t_us.min()) // _ALONE_US
        cell = bins * (height * width) + (rows + 1) * width + columns + 1
        busy, near = np.unique(cell), np.zeros(len(self), np.bool_)
        for dy, dx, dt in product((-1, 0, 1), (-1, 0, 1), (-1, 0)):
            if dx or dy:
                other = cell + dt * height * width + dy * width + dx
                near |= busy[np.minimum(np.searchsorted(busy, other), len(busy) - 1)] == other
        return ~near

    @cached_property
    def edge_hz(self) -> NDArray[np.float64]:
        """How fast events follow each other at edges: (M,) inverse intervals, 1/s.

        Of two events in a row of a pixel, of one polarity and within 100 ms, of which the second is
        not `alone`: an edge that passes makes neighbours fire, noise does not.
        """
        gap_us, _, alike = self.gaps
        edge = ~self.alone[1:][np.diff(self.pixel) == 0]
        near_us = gap_us[alike & edge & (gap_us < _SAME_EDGE_US)]
        return np.asarray(1e6 / np.maximum(near_us, 1), np.float64)

    def quiet(
        self, seen: Callable[[int], tuple[NDArray[np.float64], NDArray[np.float64]]] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What quiet pixels send: sums per tile, (B, 8), and per pixel, (P, 2).

        A pixel is quiet in 10 ms if no other pixel within 2 px sent anything in these, before or
        after. What it sends itself does not matter, so that noise is counted without choosing it.

        Args:
            seen: of a time, µs: events per second that frames lead one to expect of each pixel,
                and its light, (P,) both.

        Returns:
            Seconds, seconds times expected rate, times its square, darker events, these times the
            rate, brighter events, these times the rate, seconds times light; and seconds and
            darker events per pixel.
        """
        bins = max(3, (self.span_us[1] - self.span_us[0]) // _QUIET_US)
        number = self.counts.size
        sums, own = np.zeros((self.tiles, 8)), np.zeros((number, 2))
        when = np.minimum((self.t_us - self.span_us[0]) // _QUIET_US, bins - 1)
        order = np.argsort(when, kind="stable")
        ends = np.searchsorted(when[order], np.arange(bins + 1))
        usable = ~self.hot.ravel()
        recent: list[NDArray[np.int64]] = []
        for k in range(bins):
            chosen = order[ends[k] : ends[k + 1]]
            place = self.pixel[chosen] + number * self.on[chosen]
            recent = [*recent[-2:], np.bincount(place, minlength=2 * number).reshape(2, number)]
            if len(recent) < 3:
                continue
            alone = usable & (_others(sum(part.sum(0) for part in recent), self.shape) == 0)
            middle_us = self.span_us[0] + (2 * k - 1) * _QUIET_US // 2
            rate, light = seen(middle_us) if seen else (np.zeros(number), np.ones(number))
            cell = np.flatnonzero(alone & (rate < _SLOW_HZ))
            rate, (darker, brighter) = rate[cell], recent[1][:, cell]
            seconds = np.full(len(cell), 1e-6 * _QUIET_US)
            parts = seconds, seconds * rate, seconds * rate**2, darker, darker * rate
            known = *parts, brighter, brighter * rate, seconds * light[cell]
            for j, values in enumerate(known):
                sums[:, j] += np.bincount(self.tile[cell], values, self.tiles)
            own[cell, 0] += seconds
            own[cell, 1] += darker
        return sums, own


def _others(counts: NDArray[np.int64] | int, shape: tuple[int, int]) -> NDArray[np.int64]:
    """(P,) events of all other pixels within reach."""
    image = np.asarray(counts).reshape(shape)
    size = 2 * _QUIET_PX + 1
    padded = np.pad(image, ((_QUIET_PX + 1, _QUIET_PX), (_QUIET_PX + 1, _QUIET_PX)))
    total = padded.cumsum(0).cumsum(1)
    around = total[size:, size:] - total[:-size, size:] - total[size:, :-size]
    return np.asarray((around + total[:-size, :-size] - image).ravel(), np.int64)
