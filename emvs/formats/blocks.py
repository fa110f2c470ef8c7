"""What readers share: bounded blocks, and time slices without an index."""

from __future__ import annotations

import bz2
import io
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PosixPath
from typing import Any

import lz4.frame
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import Span, spans_of
from eventsweep.emvs.errors import InputError, offer, quoted, refused

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MOST_BYTES = 1 << 28  # what one compressed packet or chunk may unpack to
SMALL_BYTES = 1 << 26  # and what it may to whatever its own size
MOST_RATIO = 64  # how many times its own size something compressed may unpack to beyond that
_STEP = 1 << 24  # bytes that are unpacked at a time
_DECOMPRESSORS = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}
_FAULTS = (OSError, RuntimeError, ValueError, EOFError, MemoryError, zstd.ZstdError)


@dataclass(frozen=True, slots=True)
class IndexedBlock:
    """A block: where it lies, the times it covers, and how many events it holds.

    `spans` are the first and last event of each stretch without a long silence, µs.
    """

    place: Any
    spans: tuple[Span, ...]
    first_us: int
    last_us: int
    count: int

    @classmethod
    def of(cls, place: Any, t_us: NDArray[np.int64]) -> IndexedBlock:
        """A block of 1 or more events at (N,) times, µs."""
        spans = spans_of(t_us)
        return cls(place, tuple(spans), spans[0][0], spans[-1][1], len(t_us))


class BlockReader:
    """The event streams of a file, as the file holds them: in its order, nothing dropped.

    Order in time and position on the sensor are the file's business; `Events.checked` tells of
    events that run backwards or lie off the sensor. A format finds blocks of events by `scan` and
    reads them by `load`. Nothing is read before it is asked for. `chunks` reads the file once from
    front to back; `span_us`, `count` and `between` first build the index, some 100 bytes per block,
    which is kept.

    Attributes:
        format: as `emvs.formats.FORMATS` lists it.
        width_px: sensor width (of the first stream), where the file says it; so `height_px`.
        streams: one name per camera or topic.
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

    def size_px(self, stream: str) -> tuple[int, int] | None:
        """Width and height of a stream's sensor, where the file says it."""
        if stream != self.streams[0] or self.width_px is None or self.height_px is None:
            return None
        return self.width_px, self.height_px

    def span_us(self, stream: str) -> tuple[int, int]:
        """Earliest and latest time stamp, µs."""
        entries = self._index(stream)
        if not entries:
            raise InputError(f"{self.path}, stream {quoted(stream)}: no events; record it again")
        return min(e.first_us for e in entries), max(e.last_us for e in entries)

    def occupied_us(self, stream: str) -> list[Span]:
        """First and last event of stretches without a long silence, µs; they may overlap."""
        return [span for entry in self._index(stream) for span in entry.spans]

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

    def share_before(self, _stream: str, place: Any) -> float:
        """Which share of a stream ends with a block; here its place is its first byte and size."""
        return float(min(1.0, (place[0] + place[1]) / max(1, self.path.stat().st_size)))

    def check_stream(self, stream: str) -> None:
        """Refuses a stream that the file does not have."""
        if stream not in self.streams:
            raise InputError(
                f"{self.path}: no stream {stream!r}; {offer(self.streams, 'it has none')}"
            )

    def _index(self, stream: str) -> list[IndexedBlock]:
        self.check_stream(stream)
        if stream not in self._entries:
            self._entries[stream] = list(self._blocks(stream))
        return self._entries[stream]

    def _blocks(self, stream: str) -> Iterator[IndexedBlock]:
        for place, events in self.scan(stream):
            if len(events):
                yield IndexedBlock.of(place, events.t_us)


def within(events: Events, t0_us: int, t1_us: int) -> Events:
    """Events with `t0_us <= t < t1_us`, whether or not they are sorted."""
    inside = (events.t_us >= t0_us) & (events.t_us < t1_us)
    return events if inside.all() else events.take(inside)


def unpacked(data: bytes | memoryview, compression: str, where: str) -> bytes:
    """Unpacks one frame of `bz2`, `lz4` or `zstd`.

    Raises:
        InputError: damage, or more than `MOST_BYTES`, or than `MOST_RATIO` times its size where
            that is more than `SMALL_BYTES`; named after `where` (file and place).
    """
    frame: Any = _DECOMPRESSORS[compression]()
    most = min(MOST_BYTES, max(SMALL_BYTES, MOST_RATIO * len(data)))
    parts: list[bytes] = []
    cure = "; damaged, download it again"
    with refused(f"{where}: cannot be decompressed", *_FAULTS, cure=cure):
        # LZ4 reserves the whole length that it is allowed, so that is a guess, not the bound.
        guess = min(8 * len(data) + 1024, most)
        parts.append(frame.decompress(data, max_length=guess))
        while not (frame.eof or frame.needs_input or sum(map(len, parts)) >= most):
            parts.append(frame.decompress(b"", max_length=_STEP))
    if not frame.eof:
        raise InputError(
            f"{where}: its compressed frame has no end, or unpacks to more than {most} "
            "bytes; the file is damaged, download it again"
        )
    return b"".join(parts)


class BoundedPath(PosixPath):
    """A path whose file never reserves more than it holds, whatever it is asked to read."""

    def open(self, *args: Any, **kwargs: Any) -> Any:
        """Opens the file; read-only and binary as `BoundedFile`."""
        if args != ("rb",) or kwargs:
            return super().open(*args, **kwargs)
        return BoundedFile(io.FileIO(self, "rb"), self.stat().st_size)


class BoundedFile(io.BufferedReader):
    """A file of a known size, bytes."""

    def __init__(self, raw: io.FileIO, size: int) -> None:
        super().__init__(raw)
        self._size = size

    def read(self, size: int | None = -1, /) -> bytes:
        """Reads up to `size` bytes; reserves no more than the file's size for them."""
        return super().read(-1 if size is None else min(size, self._size))


class BoundedZstd(zstd.ZstdFile):
    """A compressed file, open for reading, that unpacks to a bound."""

    def __init__(self, file: io.BufferedReader, mode: Any) -> None:
        super().__init__(file, mode)
        self._most = max(MOST_BYTES, MOST_RATIO * os.fstat(file.fileno()).st_size)

    def read(self, size: int | None = -1) -> bytes:
        """Reads up to `size` bytes, unpacked.

        Raises:
            ValueError: these end beyond the bound.
        """
        data = super().read(size)
        if self.tell() > self._most:
            raise ValueError(f"a compressed file unpacks to more than {self._most} bytes")
        return data
