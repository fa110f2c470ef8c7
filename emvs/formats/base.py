"""What every event format offers: a lazy reader, a streaming writer, and its limits in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from eventsweep.emvs.data.events import Events, check_sorted, check_span
from eventsweep.emvs.errors import InputError, located

# Packets of events per stream name, each stream in the order in which it is to be written
Streams = Mapping[str, Iterable[Events]]
# Width and height of each stream's sensor, px
Sizes = Mapping[str, tuple[int, int]]
# Called with the number of events written so far
OnWritten = Callable[[int], None]
# Limits of formats that set none: 16-bit pixels, times of 62 bits, streams
ANY_PX = (1 << 16) - 1
ANY_US = (1 << 62) - 1
DOUBLE_US = 1 << 51  # up to here seconds in a double still round to the right microsecond
MANY = 1 << 16


@dataclass(frozen=True, slots=True)
class Limits:
    """What a format can hold; its writer refuses the rest.

    Attributes:
        unit: what the file counts time in.
        why: what stands behind the numbers, in a few words.
        max_us: largest time stamp that is written, µs (all begin at 0).
        max_x: largest column, px, as `max_y` is the row.
        keeps_order: whether time stamps that run backwards survive.
        streams: how many streams one file holds at most.
        max_span_us: largest time between the first event of a stream and its last, µs.
    """

    unit: str
    why: str
    max_us: int = ANY_US
    max_x: int = ANY_PX
    max_y: int = ANY_PX
    keeps_order: bool = True
    streams: int = 1
    max_span_us: int = 1 << 62


class Checker:
    """Refuses what a format cannot hold, and events off the sensor; counts the rest."""

    def __init__(self, path: Path, limits: Limits, sizes_px: Sizes) -> None:
        for width_px, height_px in sizes_px.values():
            if not (0 < width_px <= limits.max_x + 1 and 0 < height_px <= limits.max_y + 1):
                raise InputError(
                    f"{path}: a sensor of {width_px}x{height_px} does not fit this format, which "
                    f"holds 1x1 to {limits.max_x + 1}x{limits.max_y + 1} ({limits.why}): choose "
                    "another"
                )
        self._path, self._limits, self._sizes_px = path, limits, dict(sizes_px)
        self._first_us: dict[str, int] = {}
        self._last_us: dict[str, int] = {}
        self._rows: dict[str, int] = {}
        self.count = 0

    def __call__(self, stream: str, events: Events) -> Events:
        """Returns the packet itself."""
        if not len(events):
            return events
        with located(f"{self._path}, stream {stream!r}"):
            events.check_inside(*self._sizes_px[stream])
            if not self._limits.keeps_order:
                check_sorted(events.t_us, self._rows.get(stream, 0))
        self._check_times(stream, events)
        self._rows[stream] = self._rows.get(stream, 0) + len(events)
        self.count += len(events)
        return events

    def _check_times(self, stream: str, events: Events) -> None:
        first, last = int(events.t_us.min()), int(events.t_us.max())
        began = self._first_us.setdefault(stream, first)
        if first < 0 or last > self._limits.max_us:
            fits = last - began <= self._limits.max_us
            raise InputError(
                f"{self._path}, stream {stream!r}: time {first if first < 0 else last} µs; this "
                f"format holds 0 to {self._limits.max_us} µs ({self._limits.why}): "
                + ("shift the times" if fits else f"cut the recording, it begins at {began} µs")
            )
        before = self._last_us.get(stream, 0)
        if not self._limits.keeps_order and first < before:
            raise InputError(
                f"{self._path}, stream {stream!r}: a packet begins at {first} µs, before the "
                f"last event written ({before} µs): sort the events by time (stable sort)"
            )
        if last - began > self._limits.max_span_us:
            with located(f"{self._path}, stream {stream!r}"):
                check_span(began, self._last_us.get(stream), events.t_us)
        self._last_us[stream] = last


class StreamWriter:
    """Appends packets of events, which `Checker` has already found to fit; use it as a context.

    Attributes:
        packet: how many events are written at once, at most.
    """

    packet = 1 << 16

    def append(self, stream: str, events: Events) -> None:
        """Writes a packet, in parts where it is large."""
        for start in range(0, len(events), self.packet):
            self._put(stream, events.slice(start, min(start + self.packet, len(events))))

    def _put(self, stream: str, events: Events) -> None:
        """Writes 1 to `packet` events."""
        raise NotImplementedError

    def _finish(self) -> None:
        """Writes what stands at the end of a whole file."""

    def _close(self) -> None:
        """Lets go of the file, whole or not."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        try:
            if error is None:
                self._finish()
        finally:
            self._close()


class GatheringWriter(StreamWriter):
    """A writer to which large packets come much cheaper: small ones wait for each other."""

    packet = 1 << 20
    _LEAST = 1 << 18

    def __init__(self) -> None:
        self._waiting: dict[str, list[Events]] = {}
        self._counts: dict[str, int] = {}

    def append(self, stream: str, events: Events) -> None:
        """Writes a packet, or lets it wait."""
        self._waiting.setdefault(stream, []).append(events)
        self._counts[stream] = self._counts.get(stream, 0) + len(events)
        if self._counts[stream] >= self._LEAST:
            self._empty(stream)

    def _empty(self, stream: str) -> None:
        waiting = self._waiting.pop(stream)
        self._counts[stream] = 0
        super().append(stream, waiting[0] if len(waiting) == 1 else Events.concat(waiting))

    def _finish(self) -> None:
        for stream in list(self._waiting):
            self._empty(stream)


class FileWriter(StreamWriter):
    """A writer of bytes, one after another."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")

    def _close(self) -> None:
        self._file.close()
