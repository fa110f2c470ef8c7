"""Reads events from AEDAT4 files: one stream per event output of the recording.

Layout after iniVation's description of AEDAT 4.0: a line, a header buffer with an XML tree of the
streams, then packets (stream, size, compressed buffer), then a table of them, which is not needed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree import ElementTree

import numpy as np

from emvs.data.events import Events
from emvs.errors import InputError
from emvs.io.events.bounded import MOST_BYTES, unpacked
from emvs.io.events.convert_columns import to_events
from emvs.io.events.flatbuffer import FlatbufferTable
from emvs.io.events.indexed import BlockReader
from emvs.io.events.raw import opened
from emvs.io.events.wording import quoted, said

MAGIC = b"#!AER-DAT4.0\r\n"
EVENT = np.dtype(
    {
        "names": ["t", "x", "y", "p"],
        "formats": ["<i8", "<i2", "<i2", "u1"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)
_MOST_HEADER = 1 << 20


class Aedat4Reader(BlockReader):
    """An AEDAT4 file; streams bear the names of the recording's outputs, and their number.

    Raises:
        InputError: a missing or damaged file, or one without events.
    """

    format = "aedat4"

    def __init__(self, path: Path) -> None:
        path = Path(path)
        with opened(path) as file:
            self._compression, self._stop, tree = _header(path, file)
            self._start = file.tell()
        self._numbers, sizes = _streams(path, tree)
        super().__init__(path, tuple(self._numbers))
        if not self.streams:
            raise InputError(f"{path}: no stream of events (EVTS); record it with events")
        self.width_px, self.height_px = sizes[self.streams[0]] or (None, None)

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads the stream's packets from front to back, passing over the others."""
        wanted = self._numbers[stream]
        size = self.path.stat().st_size
        stop = self._stop if 0 < self._stop <= size else size
        if self._stop > size:
            raise InputError(
                f"{self.path}, byte {size}: cut off, its table should begin at byte {self._stop}; "
                "fetch it again"
            )
        with opened(self.path) as file:
            at = file.seek(self._start)
            while at < stop:
                number, length = self._packet_head(file, at, stop)
                if number == wanted:
                    yield (at + 8, length), self._packet(file, at + 8, length)
                at = file.seek(at + 8 + length)

    def load(self, stream: str, place: Any) -> Events:
        """Reads one packet."""
        del stream
        with opened(self.path) as file:
            file.seek(place[0])
            return self._packet(file, *place)

    def _packet_head(self, file: BinaryIO, at: int, stop: int) -> tuple[int, int]:
        data = file.read(8)
        number, length = struct.unpack("<ii", data) if len(data) == 8 else (-1, -1)
        if length < 0 or at + 8 + length > stop or length > MOST_BYTES:
            raise InputError(
                f"{self.path}, byte {at}: a packet of {length} bytes with {max(0, stop - at - 8)} "
                "left; the file is cut off or damaged, fetch it again"
            )
        return number, length

    def _packet(self, file: BinaryIO, at: int, length: int) -> Events:
        where = f"{self.path}, packet at byte {at}"
        data = file.read(length)
        if self._compression:
            data = unpacked(data, "lz4" if self._compression < 3 else "zstd", where)
        rows = np.frombuffer(FlatbufferTable(data, b"EVTS", where).vector(0, EVENT.itemsize), EVENT)
        return to_events(where, rows["x"], rows["y"], rows["t"], rows["p"], 1e-6)


def _header(path: Path, file: BinaryIO) -> tuple[int, int, ElementTree.Element]:
    """Compression, where the table begins (-1: nowhere), and the tree of streams."""
    if file.read(len(MAGIC)) != MAGIC:
        raise InputError(f"{path}, byte 0: no AEDAT4 file; older versions must be converted first")
    size = file.read(4)
    length = int.from_bytes(size, "little")
    if length > _MOST_HEADER:
        raise InputError(f"{path}, byte {len(MAGIC)}: a header of {length} bytes; damaged")
    table = FlatbufferTable(size + file.read(length), b"IOHE", f"{path}, header")
    compression = table.number(0, "i", 0)
    if not 0 <= compression <= 4:
        raise InputError(f"{path}, header: compression {compression} is unknown; needs 0 to 4")
    text = bytes(table.vector(2, 1))
    if b"<!" in text:
        raise InputError(f"{path}, header: XML with declarations; no recorder writes them, damaged")
    try:
        tree = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path}, header: damaged XML ({said(error)}); fetch it again") from error
    return compression, table.number(1, "q", -1), tree


def _streams(
    path: Path, tree: ElementTree.Element
) -> tuple[dict[str, int], dict[str, tuple[int, int] | None]]:
    """Number and sensor size of each stream of events."""
    numbers: dict[str, int] = {}
    sizes: dict[str, tuple[int, int] | None] = {}
    for node in tree.iterfind("node[@name='outInfo']/node"):
        values = {a.get("key"): (a.text or "").strip() for a in node.iterfind("attr")}
        info = {a.get("key"): (a.text or "").strip() for a in node.iterfind("node/attr")}
        if values.get("typeIdentifier") != "EVTS":
            continue
        number = node.get("name", "")
        size = info.get("sizeX", "0"), info.get("sizeY", "0")
        if not all(w.isdecimal() and w.isascii() and len(w) < 6 for w in (number, *size)):
            raise InputError(
                f"{path}, header: stream {quoted(number)} of size {quoted(*size)}; damaged"
            )
        name = values.get("originalOutputName") or "events"
        name = name if name not in numbers else f"{name}-{number}"
        numbers[name] = int(number)
        sizes[name] = (int(size[0]), int(size[1])) if all(map(int, size)) else None
    return numbers, sizes
