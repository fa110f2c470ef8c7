"""Time slices of formats that have no index: one pass notes which block covers which time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from emvs.data.events import Events
from emvs.errors import InputError
from emvs.io.events.wording import quoted


@dataclass(frozen=True, slots=True)
class IndexedBlock:
    """A block: where it lies, the times it covers, and how many events it holds."""

    place: Any
    first_us: int
    last_us: int
    count: int


class BlockReader:
    """An `EventReader` over blocks of events that a format finds by `scan` and reads by `load`.

    Nothing is read before it is asked for. `chunks` reads the file once from front to back;
    `span_us`, `count` and `between` first build the index, some 100 bytes per block, which is kept.
    """

    format = ""
    width_px: int | None = None
    height_px: int | None = None

    def __init__(self, path: Path, streams: tuple[str, ...]) -> None:
        self.path = path
        self.streams = streams
        self._entries: dict[str, list[IndexedBlock]] = {}
        self._share: dict[str, float] = {}

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Blocks in file order: what `load` needs to find each one again, and its events."""
        raise NotImplementedError

    def load(self, stream: str, place: Any) -> Events:
        """The events of one block."""
        raise NotImplementedError

    def span_us(self, stream: str) -> tuple[int, int]:
        """Earliest and latest time stamp, µs."""
        entries = self._index(stream)
        if not entries:
            raise InputError(f"{self.path}, stream {quoted(stream)}: no events; record it again")
        return min(e.first_us for e in entries), max(e.last_us for e in entries)

    def count(self, stream: str) -> int:
        """How many events there are."""
        return sum(entry.count for entry in self._index(stream))

    def between(self, stream: str, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`, in file order."""
        wanted = [e for e in self._index(stream) if e.last_us >= t0_us and e.first_us < t1_us]
        return Events.concat([within(self.load(stream, e.place), t0_us, t1_us) for e in wanted])

    def chunks(self, stream: str, max_events: int = 1 << 20) -> Iterator[Events]:
        """All events in file order, in packets of 1 to `max_events`."""
        self.check_stream(stream)
        if max_events < 1:
            raise InputError(f"{max_events} events per packet: needs at least 1")
        self._share[stream] = 0.0
        for place, events in self.scan(stream):
            self._share[stream] = self.share_before(stream, place)
            for start in range(0, len(events), max_events):
                yield events.slice(start, min(start + max_events, len(events)))
        self._share[stream] = 1.0

    def share(self, stream: str) -> float:
        """How much of the stream `chunks` has read, 0 to 1."""
        return self._share.get(stream, 0.0)

    def share_before(self, stream: str, place: Any) -> float:
        """Which share of a stream ends with a block; here its place is its first byte and size."""
        del stream
        return float(min(1.0, (place[0] + place[1]) / max(1, self.path.stat().st_size)))

    def check_stream(self, stream: str) -> None:
        """Refuses a stream that the file does not have."""
        if stream not in self.streams:
            raise InputError(
                f"{self.path}: no stream {stream!r}; there are {quoted(*self.streams) or 'none'}"
            )

    def _index(self, stream: str) -> list[IndexedBlock]:
        self.check_stream(stream)
        if stream not in self._entries:
            self._entries[stream] = [
                IndexedBlock(place, int(events.t_us.min()), int(events.t_us.max()), len(events))
                for place, events in self.scan(stream)
                if len(events)
            ]
        return self._entries[stream]


def within(events: Events, t0_us: int, t1_us: int) -> Events:
    """Events with `t0_us <= t < t1_us`, whether or not they are sorted."""
    inside = (events.t_us >= t0_us) & (events.t_us < t1_us)
    if inside.all():
        return events
    return Events(events.x[inside], events.y[inside], events.t_us[inside], events.p[inside])


def checked_times(events: Events, where: str) -> Events:
    """Returns the events; no format here has time stamps below 0 or beyond 2^62 µs.

    Raises:
        InputError: a time stamp is, named after `where` (file and place).
    """
    bad = np.flatnonzero((events.t_us < 0) | (events.t_us > 1 << 62))
    if bad.size:
        k = int(bad[0])
        raise InputError(
            f"{where}: event {k} at {events.t_us[k]} µs; needs 0 to 2^62 µs: the file is damaged "
            "or its epoch is not its start, shift its times"
        )
    return events
