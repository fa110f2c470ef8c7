"""Events as columns: sorted by time, four arrays of one length; made of what a file holds.

What a file says of pixels, times and polarity is checked here, whatever its format.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.headers import check_whole_us
from eventsweep.emvs.errors import InputError, check_array

Numbers = NDArray[Any]
Columns = tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.int64], NDArray[np.uint8]]
LARGEST_US = 1 << 62
MOST_SPAN_US = 1 << 36
"""With more the index by milliseconds would be larger than the events; 19 hours."""


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
        return cls.room(0)

    @classmethod
    def room(cls, count: int) -> Events:
        """Columns for so many events, to be filled."""
        x, y = np.empty(count, np.uint16), np.empty(count, np.uint16)
        return cls(x, y, np.empty(count, np.int64), np.empty(count, np.uint8))

    @property
    def columns(self) -> Columns:
        """`x`, `y`, `t_us` and `p`, as kernels take them."""
        return self.x, self.y, self.t_us, self.p

    @classmethod
    def concat(cls, parts: Sequence[Events]) -> Events:
        """Joins stretches in the order given."""
        if not parts:
            return cls.empty()
        return cls(*map(np.concatenate, zip(*(part.columns for part in parts), strict=True)))

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
        self.check_inside(width_px, height_px)
        return self

    def check_inside(self, width_px: int, height_px: int) -> None:
        """Refuses events off the sensor."""
        if len(self.x) and (self.x.max() >= width_px or self.y.max() >= height_px):
            outside = np.flatnonzero((self.x >= width_px) | (self.y >= height_px))
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


def check_span(first_us: int, before_us: int | None, t_us: NDArray[np.int64]) -> None:
    """Refuses (N,) times that lie too far behind the first for an index; names the longest silence.

    `before_us` is the time of the last event before them, if any.
    """
    if int(t_us[-1]) - first_us <= MOST_SPAN_US:
        return
    times = t_us if before_us is None else np.append(before_us, t_us)
    k = int(np.diff(times).argmax()) if len(times) > 1 else 0
    begin_us, end_us = int(times[k]), int(times[min(k + 1, len(times) - 1)])
    raise InputError(
        f"time {t_us[-1]} µs lies more than {MOST_SPAN_US} µs after the first event, behind no "
        f"event for {(end_us - begin_us) / 1e6:g} s from {begin_us} µs: an index by milliseconds "
        "would be larger than the events; cut the recording there, or choose npz"
    )


def count_late(t_us: NDArray[np.int64], latest_us: int) -> int:
    """How many events of a packet are earlier than one before them, or than `latest_us`."""
    if not len(t_us) or (t_us[0] >= latest_us and (t_us[1:] >= t_us[:-1]).all()):
        return 0
    running = np.maximum.accumulate(np.maximum(t_us, latest_us))
    return int(np.count_nonzero(t_us < running))


def to_events(
    where: str, x: Numbers, y: Numbers, t: Numbers, p: Numbers, unit_s: float | None
) -> Events:
    """Events from columns of one length.

    Args:
        where: file and place, for the errors' sake.
        x: (N,) columns, px.
        y: (N,) rows, px.
        t: (N,) times in `unit_s`.
        p: (N,) polarity: 0 or -1 for darker, 1 for brighter.
        unit_s: what times count, s; None: µs where whole numbers, seconds where floating.

    Raises:
        InputError: a value that is not finite, whole (pixels) or in range.
    """
    if unit_s is None:
        unit_s = 1.0 if t.dtype.kind == "f" else 1e-6
        if unit_s == 1e-6 and len(t):
            check_whole_us(where, int(t[0]))
    return events_at(where, x, y, times_us(where, t, unit_s), p)


def events_at(where: str, x: Numbers, y: Numbers, t_us: NDArray[np.int64], p: Numbers) -> Events:
    """The same where times are known already, µs."""
    return Events(_pixels(where, "x", x), _pixels(where, "y", y), t_us, _polarity(where, p))


def times_us(where: str, t: Numbers, unit_s: float) -> NDArray[np.int64]:
    """Times in whole µs, rounded to the nearest; no format here has any below 0 or above 2^62."""
    if t.dtype.kind == "f":
        with np.errstate(over="ignore", invalid="ignore"):
            t_us = t.astype(np.float64) * (unit_s * 1e6)
        _refuse(where, "t", t, ~(np.abs(t_us) < LARGEST_US), "finite times below 2^62 µs")
        return checked_times(np.rint(t_us).astype(np.int64), where)
    if len(t) and t.max() >= LARGEST_US:
        _refuse(where, "t", t, t >= LARGEST_US, "times below 2^62")
    whole = t.astype(np.int64, copy=False)
    if unit_s == 1e-9:
        whole = (whole + 500) // 1000
    elif unit_s != 1e-6:
        _refuse(where, "t", t, np.abs(whole) >= 1 << 42, "times below 2^42")
        whole = whole * round(unit_s * 1e6)
    return checked_times(whole, where)


def checked_times(t_us: NDArray[np.int64], where: str, least_us: int = 0) -> NDArray[np.int64]:
    """Returns (N,) times, µs, of which none is before the least or beyond 2^62."""
    if len(t_us) and not least_us <= t_us.min() <= t_us.max() <= LARGEST_US:
        k = int(np.argmax((t_us < least_us) | (t_us > LARGEST_US)))
        raise InputError(
            f"{where}: event {k} at {t_us[k]} µs; needs 0 to 2^62 µs: shift the times if "
            "they count from another epoch, otherwise the file is damaged"
        )
    return t_us


def _pixels(where: str, name: str, values: Numbers) -> NDArray[np.uint16]:
    if values.dtype == np.uint16:
        return values
    with np.errstate(invalid="ignore"):
        bad = ~((values >= 0) & (values <= 65535))
        if values.dtype.kind == "f":
            bad |= values != np.floor(values)
    _refuse(where, name, values, bad, "whole pixels from 0 to 65535")
    return values.astype(np.uint16)


def _polarity(where: str, values: Numbers) -> NDArray[np.uint8]:
    if values.dtype.kind == "b" or (values.dtype == np.uint8 and values.max(initial=0) <= 1):
        return values.astype(np.uint8, copy=False)
    bad = (values != 0) & (values != 1)
    if values.dtype.kind != "u":
        bad &= values != -1
    _refuse(where, "p", values, bad, "0 or 1, or -1 or 1")
    return (values > 0).astype(np.uint8)


def _refuse(where: str, name: str, values: Numbers, bad: NDArray[np.bool_], needs: str) -> None:
    if bad.any():
        k = int(np.argmax(bad))
        raise InputError(
            f"{where}: {name} of event {k} is {values[k]}, needs {needs}: the file is damaged, "
            "or its columns are assigned wrongly"
        )
