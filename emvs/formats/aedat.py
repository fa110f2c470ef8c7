"""AEDAT 2.0 of jAER and 3.1 of cAER and libcaer: the events of DVS128 and DAVIS, read in blocks.

Layouts after iniVation's description of its file formats. AEDAT 2.0 has the chip's own addresses,
which count columns from the right and rows from below as jAER draws them; here, as in AEDAT 3.1,
pixels count from the upper left. Frames, inertial samples, triggers and invalid events are passed
over.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events, checked_times
from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.formats.blocks import BlockReader
from eventsweep.emvs.formats.prophesee import STREAM, opened

MAGIC_2, MAGIC_3 = b"#!AER-DAT2.0", b"#!AER-DAT3.1"
_DAVIS_PX = {
    "128": (128, 128), "208": (208, 192), "240": (240, 180), "346": (346, 260), "640": (640, 480),
}  # fmt: skip
_DAVIS = re.compile(r"davis\D{0,3}(\d{3})", re.IGNORECASE)
_DVS128 = re.compile(r"dvs_?128|tmpdiff128", re.IGNORECASE)
_MOST_HEADER = 1 << 16
_BLOCK_EVENTS = 1 << 17
_HALF = 1 << 31
_PACKET = struct.Struct("<hhiiiiii")
_POLARITY = 1
Words = NDArray[np.int64]


class _Chip(NamedTuple):
    """Size, px; which addresses are events; their column, row and polarity as the chip has them.

    Addresses lie below `limit`.
    """

    size_px: tuple[int, int]
    is_event: Callable[[Words], NDArray[np.bool_]]
    place: Callable[[Words], tuple[Words, Words, Words]]
    limit: int = 1 << 32


def _dvs128(limit: int) -> _Chip:
    """Addresses of 15 bits; the lowest is set where it became darker."""
    return _Chip(
        (128, 128),
        lambda a: a < 1 << 15,
        lambda a: ((a >> 1) & 0x7F, (a >> 8) & 0x7F, 1 - (a & 1)),
        limit,
    )


def _davis(size_px: tuple[int, int]) -> _Chip:
    """Bit 31 marks frames and inertial samples, bit 10 triggers."""
    return _Chip(
        size_px,
        lambda a: a & 0x8000_0400 == 0,
        lambda a: ((a >> 12) & 0x3FF, (a >> 22) & 0x1FF, (a >> 11) & 1),
    )


class Aedat2Reader(BlockReader):
    """An AEDAT 2.0 file: one stream, `events`; loops of its 32 bits of µs are counted."""

    format = "aedat2"

    def __init__(self, path: Path) -> None:
        super().__init__(Path(path), (STREAM,))
        with opened(self.path) as file:
            lines = _header(self.path, file)
            self._start = file.tell()
            first = file.read(8 * _BLOCK_EVENTS)
        addresses = np.frombuffer(first[: len(first) // 8 * 8], ">u4")[::2]
        self._chip = _chip_of(self.path, lines, addresses)
        self.width_px, self.height_px = self._chip.size_px
        size = self.path.stat().st_size
        if excess := (size - self._start) % 8:
            raise InputError(
                f"{self.path}, byte {size - excess}: cut off in the middle of an event; download "
                f"it again, or remove the last {excess} bytes"
            )

    def scan(self, _stream: str) -> Iterator[tuple[Any, Events]]:
        """Decodes the file from front to back."""
        with opened(self.path) as file:
            offset, last_us = file.seek(self._start), 0
            while data := file.read(8 * _BLOCK_EVENTS):
                events, after_us = self._decode(data, offset, last_us)
                yield (offset, len(data), last_us), events
                offset, last_us = offset + len(data), after_us

    def load(self, _stream: str, place: Any) -> Events:
        """Decodes one block."""
        offset, size, last_us = place
        with opened(self.path) as file:
            file.seek(offset)
            return self._decode(file.read(size), offset, last_us)[0]

    def _decode(self, data: bytes, offset: int, last_us: int) -> tuple[Events, int]:
        """The events of words behind a time, and the time of the last word, loops included."""
        words = np.frombuffer(data, ">u4").reshape(-1, 2).astype(np.int64)
        address, stamp = words[:, 0], words[:, 1]
        before = np.concatenate([[last_us % (2 * _HALF)], stamp[:-1]])
        t_us = stamp + (last_us // (2 * _HALF) + np.cumsum(before - stamp >= _HALF)) * 2 * _HALF
        wanted = self._chip.is_event(address)
        x, y, p = self._chip.place(address)
        width, height = self._chip.size_px
        outside = wanted & ((x >= width) | (y >= height)) | (address >= self._chip.limit)
        if outside.any():
            k = int(np.argmax(outside))
            raise InputError(
                f"{self.path}, byte {offset + 8 * k}: address {int(address[k]):#x} lies off the "
                f"{width}x{height} pixels of its chip; the file is damaged or of another chip"
            )
        places = width - 1 - x, height - 1 - y
        x_px, y_px = (place[wanted].astype(np.uint16) for place in places)
        events = Events(x_px, y_px, t_us[wanted], p[wanted].astype(np.uint8))
        return events, int(t_us[-1])


def _header(path: Path, file: BinaryIO) -> list[str]:
    """Reads the lines of a header and leaves the file where its data begin."""
    lines: list[str] = []
    while file.tell() < _MOST_HEADER:
        at = file.tell()
        line = file.readline(_MOST_HEADER)
        if not re.fullmatch(rb"#[\t\x20-\x7e\x80-\xff]*\r?\n", line):
            file.seek(at)
            return lines
        lines.append(line.decode("latin-1").strip())
        if re.match("#!END-HEADER|# ?End Of ASCII", lines[-1], re.IGNORECASE):
            return lines
    raise InputError(f"{path}: a header of more than {_MOST_HEADER} bytes; damaged")


def _chip_of(path: Path, lines: list[str], addresses: NDArray[Any]) -> _Chip:
    """The chip that the header names, or, where it names none, a DVS128 by its short addresses."""
    named = [line for line in lines if "aechip" in line.lower()]
    text = " ".join(named)
    if match := _DAVIS.search(text):
        if match[1] in _DAVIS_PX:
            return _davis(_DAVIS_PX[match[1]])
    elif _DVS128.search(text):
        return _dvs128(1 << 32)  # what lies beyond its 15 bits are marks of jAER's own
    elif not named and (addresses < 1 << 16).all():
        return _dvs128(1 << 16)
    raise InputError(
        f"{path}: chip {quoted(text) or 'unknown'}; needs a line `# AEChip: ...` that names DVS128 "
        f"or a DAVIS of {', '.join(_DAVIS_PX)} columns"
    )


class Aedat3Reader(BlockReader):
    """An AEDAT 3.1 file; one stream, `events`, or one per source that its header names."""

    format = "aedat3"

    def __init__(self, path: Path) -> None:
        path = Path(path)
        with opened(path) as file:
            lines = _header(path, file)
            self._start = file.tell()
        kind = next((line[9:] for line in lines if line.startswith("#Format: ")), "RAW")
        if "serialized" in kind.lower():
            raise InputError(f"{path}: events are compressed ({quoted(kind)}); record it as RAW")
        found = (re.match(r"#Source (\d+): *(.*)", line) for line in lines)
        sources = {int(match[1]): match[2] for match in found if match}
        names = [STREAM] if len(sources) < 2 else [f"{STREAM}-{number}" for number in sources]
        self._sources = dict(zip(names, sources, strict=True)) if len(sources) > 1 else {}
        super().__init__(path, tuple(names))
        self.width_px, self.height_px = _size_of(next(iter(sources.values()), ""))

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads the stream's packets from front to back, passing over the others."""
        size, wanted = self.path.stat().st_size, self._sources.get(stream)
        with opened(self.path) as file:
            at = file.seek(self._start)
            while at < size:
                source, kind, overflow, count, stop = self._packet(file, at, size)
                if kind == _POLARITY:
                    wanted = source if wanted is None else wanted
                    self._check_source(at, source, wanted)
                if kind == _POLARITY and source == wanted:
                    for first in range(0, count, _BLOCK_EVENTS):
                        number = min(_BLOCK_EVENTS, count - first)
                        place = (at + _PACKET.size + 8 * first, 8 * number, overflow)
                        yield place, self._events(file, *place)
                at = file.seek(stop)

    def load(self, _stream: str, place: Any) -> Events:
        """Reads one block."""
        with opened(self.path) as file:
            return self._events(file, *place)

    def _packet(self, file: BinaryIO, at: int, size: int) -> tuple[int, int, int, int, int]:
        """A packet's source, kind, overflow and number of events, and where it ends."""
        data = file.read(_PACKET.size)
        kind, source, each, offset, overflow, _, count, _ = (
            _PACKET.unpack(data) if len(data) == _PACKET.size else (0,) * 8
        )
        stop = at + _PACKET.size + each * count
        where = f"{self.path}, packet at byte {at}"
        if each <= 0 or count < 0 or stop > size or overflow < 0:
            raise InputError(
                f"{where}: {count} events of {each} bytes, but {size - at} bytes are left; the "
                "file is cut off or damaged, download it again"
            )
        if kind < 0 or (kind == _POLARITY and (each, offset) != (8, 4)):
            raise InputError(f"{where}: compressed, or events of {each} bytes; record it as RAW")
        return source, kind, overflow, count, stop

    def _check_source(self, at: int, source: int, wanted: int) -> None:
        """Refuses events of a source that the header does not name beside others."""
        known = self._sources.values() or [wanted]
        if source not in known:
            raise InputError(
                f"{self.path}, packet at byte {at}: events of source {source} beside "
                f"{', '.join(map(str, known))}, which its header does not name; damaged"
            )

    def _events(self, file: BinaryIO, offset: int, size: int, overflow: int) -> Events:
        file.seek(offset)
        words = np.frombuffer(file.read(size), "<u4").reshape(-1, 2)
        data = words[words[:, 0] & 1 == 1, 0]
        stamp = words[words[:, 0] & 1 == 1, 1].astype(np.int32).astype(np.int64)
        t_us = np.where(stamp < 0, stamp, stamp + (overflow << 31))
        x, y = (data >> 17).astype(np.uint16), (data >> 2 & 0x7FFF).astype(np.uint16)
        where = f"{self.path}, events at byte {offset}"
        return Events(x, y, checked_times(t_us, where), (data >> 1 & 1).astype(np.uint8))


def _size_of(name: str) -> tuple[int, int] | tuple[None, None]:
    """Width and height of a chip by its name, px."""
    if _DVS128.search(name):
        return 128, 128
    match = _DAVIS.search(name)
    return _DAVIS_PX.get(match[1], (None, None)) if match else (None, None)
