"""Events as columns: sorted by time, four arrays of one length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, check_array


@dataclass(frozen=True, slots=True)
class Events:
    """A stretch of one camera's event stream.

    Attributes:
        x: (N,) uint16 columns, px.
        y: (N,) uint16 rows, px.
        t_us: (N,) int64 time stamps, µs, non-decreasing.
        p: (N,) uint8 polarity, 1 for brighter, 0 for darker.

    Raises:
        InputError: a column that is no array of numbers; `checked` looks at the values.
    """

    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    t_us: NDArray[np.int64]
    p: NDArray[np.uint8]

    def __post_init__(self) -> None:
        for name in ("x", "y", "t_us", "p"):
            check_array(f"events' column {name}", getattr(self, name), "an array (N,) of numbers")

    @classmethod
    def empty(cls) -> Events:
        """No events."""
        return cls(
            np.empty(0, np.uint16),
            np.empty(0, np.uint16),
            np.empty(0, np.int64),
            np.empty(0, np.uint8),
        )

    @classmethod
    def concat(cls, parts: Sequence[Events]) -> Events:
        """Joins stretches in the order given."""
        if not parts:
            return cls.empty()
        columns = ("x", "y", "t_us", "p")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in columns))

    def __len__(self) -> int:
        return len(self.t_us)

    def __repr__(self) -> str:
        if not len(self):
            return "Events(none)"
        if len(self) == 1:
            return f"Events(1 event at {self.t_us[0]} µs)"
        return f"Events({len(self)} events, {self.t_us[0]} to {self.t_us[-1]} µs)"

    def slice(self, start: int, stop: int) -> Events:
        """Events `start` to `stop` (exclusive), as views."""
        return self.take(slice(start, stop))

    def take(self, chosen: Any) -> Events:
        """The events of an index, mask or slice."""
        return Events(self.x[chosen], self.y[chosen], self.t_us[chosen], self.p[chosen])

    def between(self, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`, as views."""
        start, stop = np.searchsorted(self.t_us, [t0_us, t1_us], side="left")
        return self.slice(int(start), int(stop))

    def shifted(self, by_us: int) -> Events:
        """The events at other times; itself where `by_us` is 0."""
        return Events(self.x, self.y, self.t_us + by_us, self.p) if by_us else self

    def thinned(self, most: int) -> Events:
        """At most so many events, evenly through the stream; itself where there are no more."""
        if len(self) <= most:
            return self
        return self.take(np.arange(most, dtype=np.int64) * len(self) // most)

    def checked(self, width_px: int, height_px: int) -> Events:
        """Returns itself, or says which event is unsorted or outside the sensor.

        Raises:
            InputError: columns of different length, time running backwards, or an event outside
                the `width_px` x `height_px` sensor.
        """
        lengths = {len(self.x), len(self.y), len(self.t_us), len(self.p)}
        if len(lengths) != 1:
            raise InputError(
                f"event columns have different lengths {sorted(lengths)}: all must match"
            )
        check_sorted(self.t_us)
        self._check_inside(width_px, height_px)
        return self

    def _check_inside(self, width_px: int, height_px: int) -> None:
        outside = np.flatnonzero((self.x >= width_px) | (self.y >= height_px))
        if outside.size:
            k = int(outside[0])
            raise InputError(
                f"event {k} at pixel ({self.x[k]}, {self.y[k]}) lies outside the "
                f"{width_px}x{height_px} sensor ({outside.size} such events): check the "
                "calibration's resolution or remove them"
            )


def check_sorted(t_us: NDArray[np.int64], first_row: int = 0) -> None:
    """Refuses (N,) times, µs, that run backwards; `first_row` is the first one's number."""
    backwards = np.flatnonzero(t_us[1:] < t_us[:-1])
    if backwards.size:
        k = int(backwards[0]) + 1
        raise InputError(
            f"event {first_row + k} at {t_us[k]} µs comes after one at {t_us[k - 1]} µs "
            f"({backwards.size} such steps): sort the events by time (stable sort)"
        )


def count_late(t_us: NDArray[np.int64], latest_us: int) -> int:
    """How many events of a packet are earlier than one before them, or than `latest_us`."""
    if not len(t_us) or (t_us[0] >= latest_us and (t_us[1:] >= t_us[:-1]).all()):
        return 0
    running = np.maximum.accumulate(np.maximum(t_us, latest_us))
    return int(np.count_nonzero(t_us < running))
