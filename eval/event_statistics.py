"""Counts a stream of events in one pass and bounded memory: rates, gaps, and what is wrong."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events, count_late

_BINS = 512
_FIRST_BIN_US = 1000
_MOST_GAPS = 20
_MOST_PX = 2048
GAP_US = 100_000
"""The shortest silence that is reported."""


@dataclass
class StreamCount:
    """What a stream holds, after all packets were added; times in µs.

    Attributes:
        backwards: steps at which time runs backwards.
        backwards_events: events earlier than one before them.
        outside: events off the sensor, where its size is known.
        largest_x: largest column, px, as `largest_y` is the row.
        gaps: longest silences, (start, end).
        gap_count: how many silences of at least `GAP_US` there are.
        bin_us: width of a bin of `rates`.
    """

    size_px: tuple[int, int] | None
    events: int = 0
    brighter: int = 0
    first_us: int | None = None
    last_us: int | None = None
    backwards: int = 0
    backwards_events: int = 0
    outside: int = 0
    largest_x: int = 0
    largest_y: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)
    gap_count: int = 0
    bin_us: int = _FIRST_BIN_US
    _origin_us: int = 0
    _bins: NDArray[np.int64] = field(default_factory=lambda: np.zeros((2, _BINS), np.int64))
    _before_us: int | None = None
    _image: NDArray[np.int64] | None = None

    def add(self, events: Events) -> None:
        """Counts a packet, in the order of the file."""
        if not len(events):
            return
        t_us = events.t_us
        low, high = int(t_us.min()), int(t_us.max())
        self.events += len(events)
        self.brighter += int(np.count_nonzero(events.p))
        self._order(t_us)
        self._inside(events)
        self._bin(t_us, events.p, low, high)
        self.first_us = low if self.first_us is None else min(self.first_us, low)
        self.last_us = high if self.last_us is None else max(self.last_us, high)

    def rates(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Start of each bin, (N,) µs, and events per bin by polarity, (2, N): darker, brighter."""
        if self.last_us is None:
            return np.empty(0, np.int64), np.empty((2, 0), np.int64)
        used = (self.last_us - self._origin_us) // self.bin_us + 1
        starts = self._origin_us + np.arange(used, dtype=np.int64) * self.bin_us
        return starts, self._bins[:, :used].copy()

    @property
    def peak_rate_hz(self) -> float:
        """Events per second in the busiest bin."""
        return float(self._bins.sum(axis=0).max()) / self.bin_us * 1e6

    def image(self) -> NDArray[np.int64] | None:
        """(2, H, W) events per pixel: darker, brighter; None where there are none, or too far out.

        Where nobody says the sensor's size, the largest pixel does.
        """
        if self._image is None or self.size_px is not None:
            return self._image
        return self._image[:, : self.largest_y + 1, : self.largest_x + 1]

    def _order(self, t_us: NDArray[np.int64]) -> None:
        before = t_us[0] if self._before_us is None else self._before_us
        steps = np.diff(t_us, prepend=before)
        self.backwards += int(np.count_nonzero(steps < 0))
        latest = int(before) if self.last_us is None else max(self.last_us, int(before))
        self.backwards_events += count_late(t_us, latest)
        wide = np.flatnonzero(steps >= GAP_US)
        self.gap_count += len(wide)
        if len(wide):
            longest = wide[np.argsort(-steps[wide], kind="stable")[:_MOST_GAPS]]
            gaps = [(int(t_us[k] - steps[k]), int(t_us[k])) for k in longest]
            every = sorted(self.gaps + gaps, key=lambda gap: gap[0] - gap[1])
            self.gaps = every[:_MOST_GAPS]
        self._before_us = int(t_us[-1])

    def _inside(self, events: Events) -> None:
        self.largest_x = max(self.largest_x, int(events.x.max()))
        self.largest_y = max(self.largest_y, int(events.y.max()))
        if self.size_px is None:
            self._make_room()
        elif self._image is None:
            self._image = np.zeros((2, *self.size_px[::-1]), np.int64)
        if self._image is None:
            return
        _, height, width = self._image.shape
        if self.largest_x >= width or self.largest_y >= height:
            good = (events.x < width) & (events.y < height)
            self.outside += len(events) - int(np.count_nonzero(good))
            events = events.take(good)
        at = np.multiply(events.y, width, dtype=np.int64)
        at += events.x
        at += np.multiply(events.p > 0, width * height, dtype=np.int64)
        self._image += np.bincount(at, minlength=2 * width * height).reshape(2, height, width)

    def _make_room(self) -> None:
        """Doubles the image until the largest pixel fits; gives up where none has such a sensor."""
        if max(self.largest_x, self.largest_y) >= _MOST_PX:
            self._image = None
            return
        height, width = (0, 0) if self._image is None else self._image.shape[1:]
        if self.largest_x < width and self.largest_y < height:
            return
        rows, columns = (
            1 << max(6, last.bit_length()) for last in (self.largest_y, self.largest_x)
        )
        image = np.zeros((2, max(height, rows), max(width, columns)), np.int64)
        if self._image is not None:
            image[:, :height, :width] = self._image
        self._image = image

    def _bin(self, t_us: NDArray[np.int64], p: NDArray[np.uint8], low: int, high: int) -> None:
        if self.first_us is None:
            self._origin_us = low // self.bin_us * self.bin_us
        while low < self._origin_us:
            self._widen(down=True)
        while high >= self._origin_us + _BINS * self.bin_us:
            self._widen(down=False)
        at = (t_us - self._origin_us) // self.bin_us + (p > 0) * _BINS
        self._bins += np.bincount(at, minlength=2 * _BINS).reshape(2, _BINS)

    def _widen(self, *, down: bool) -> None:
        """Doubles the bins' width; the last bin ends where it did, or the first begins there."""
        half = self._bins.reshape(2, _BINS // 2, 2).sum(axis=2)
        free = np.zeros_like(half)
        self._bins = np.concatenate([free, half] if down else [half, free], axis=1)
        self._origin_us -= _BINS * self.bin_us if down else 0
        self.bin_us *= 2
