"""AEDAT4 files, read and written: one stream per event output of the recording.

Layout after iniVation's description of AEDAT 4.0: a line, a header buffer with an XML tree of the
streams, then packets (stream, size, compressed buffer), then a table of them, which is not needed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree import ElementTree

import lz4.frame
import numpy as np

from eventsweep.emvs.data.events import Events, to_events
from eventsweep.emvs.errors import InputError, quoted, refused
from eventsweep.emvs.formats.base import FileWriter, Sizes
from eventsweep.emvs.formats.blocks import MOST_BYTES, BlockReader, unpacked
from eventsweep.emvs.formats.prophesee import opened

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
_LZ4 = 1


class Aedat4Reader(BlockReader):
    """An AEDAT4 file; streams bear the names of the recording's outputs, and their number."""

    format = "aedat4"

    def __init__(self, path: Path) -> None:
        path = Path(path)
        with opened(path) as file:
            self._compression, self._stop, tree = _header(path, file)
            self._start = file.tell()
        outputs = _streams(path, tree)
        self._numbers = {name: number for name, (number, *_) in outputs.items()}
        super().__init__(path, tuple(outputs))
        if not self.streams:
            raise InputError(f"{path}: no event stream (EVTS); record with events switched on")
        self._sizes_px = {name: (width, height) for name, (_, width, height) in outputs.items()}
        self.width_px, self.height_px = self.size_px(self.streams[0]) or (None, None)

    def size_px(self, stream: str) -> tuple[int, int] | None:
        """Width and height of a stream's sensor, where the header says it."""
        size_px = self._sizes_px[stream]
        return size_px if all(size_px) else None

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads the stream's packets from front to back, passing over the others."""
        wanted = self._numbers[stream]
        size = self.path.stat().st_size
        stop = self._stop if 0 < self._stop <= size else size
        if self._stop > size:
            raise InputError(
                f"{self.path}, byte {size}: cut off before its packet table at byte "
                f"{self._stop}; download it again"
            )
        with opened(self.path) as file:
            at = file.seek(self._start)
            while at < stop:
                number, length = self._packet_head(file, at, stop)
                if number == wanted:
                    yield (at + 8, length), self._packet(file, at + 8, length)
                at = file.seek(at + 8 + length)

    def load(self, _stream: str, place: Any) -> Events:
        """Reads one packet."""
        with opened(self.path) as file:
            file.seek(place[0])
            return self._packet(file, *place)

    def _packet_head(self, file: BinaryIO, at: int, stop: int) -> tuple[int, int]:
        data = file.read(8)
        number, length = struct.unpack("<ii", data) if len(data) == 8 else (-1, -1)
        if length < 0 or at + 8 + length > stop or length > MOST_BYTES:
            raise InputError(
                f"{self.path}, byte {at}: a packet of {length} bytes, but "
                f"{max(0, stop - at - 8)} are left; the file is cut off or damaged, download it "
                "again"
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
        raise InputError(f"{path}, byte 0: not AEDAT 2.0, 3.1 or 4.0; convert it first")
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
        raise InputError(
            f"{path}, header: XML with declarations, which no recorder writes; damaged"
        )
    faults = ElementTree.ParseError, ValueError, LookupError
    with refused(f"{path}, header: damaged XML", *faults, cure="; download it again"):
        tree = ElementTree.fromstring(text)
    return compression, table.number(1, "q", -1), tree


def _streams(path: Path, tree: ElementTree.Element) -> dict[str, tuple[int, int, int]]:
    """Number, and width and height of the sensor (0: unknown), of each stream of events."""
    outputs: dict[str, tuple[int, int, int]] = {}
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
        name = name if name not in outputs else f"{name}-{number}"
        outputs[name] = int(number), int(size[0]), int(size[1])
    return outputs


class Aedat4Writer(FileWriter):
    """Appends packets of up to 16384 events."""

    packet = 1 << 14

    def __init__(self, path: Path, sizes_px: Sizes) -> None:
        self._numbers = {name: k for k, name in enumerate(sizes_px)}
        self._tree = _tree(sizes_px)
        self._table: list[tuple[int, int, int, int, int, int]] = []
        super().__init__(path)
        self._file.write(MAGIC + _header_buffer(self._tree, -1))

    def _put(self, stream: str, events: Events) -> None:
        rows = np.zeros(len(events), EVENT)
        rows["t"], rows["x"], rows["y"] = events.t_us, events.x, events.y
        rows["p"] = events.p > 0
        data = lz4.frame.compress(one_vector(b"EVTS", len(events), rows.tobytes()))
        number = self._numbers[stream]
        times = int(events.t_us[0]), int(events.t_us[-1])
        self._table.append((self._file.tell() + 8, number, len(data), len(events), *times))
        self._file.write(struct.pack("<ii", number, len(data)) + data)

    def _finish(self) -> None:
        place = self._file.tell()
        self._file.write(lz4.frame.compress(_packet_table(self._table)))
        self._file.seek(len(MAGIC))
        self._file.write(_header_buffer(self._tree, place))


def _header_buffer(tree: bytes, table_place: int) -> bytes:
    """The IOHE buffer: compression, place of the table, the XML tree; of the same size always."""
    buffer = struct.pack("<I4s6x5H", 24, b"IOHE", 10, 24, 4, 12, 8)
    buffer += struct.pack("<iiIq4xI", 10, _LZ4, 16, table_place, len(tree))
    buffer += tree + b"\0" * (8 - len(tree) % 8)
    return struct.pack("<I", len(buffer)) + buffer


def _packet_table(rows: list[tuple[int, int, int, int, int, int]]) -> bytes:
    """The FTAB buffer: where each packet's data begin, its head, event count, first and last time.

    The tables follow their offsets, all of one shape; padding keeps 64-bit numbers aligned.
    """
    shape_at = 4 * len(rows) + (-4 * len(rows)) % 8
    first_at = shape_at + 20
    offsets = np.array([first_at + 48 * k - 4 * k for k in range(len(rows))], "<u4").tobytes()
    shape = struct.pack("<7H6x", 14, 44, 12, 4, 20, 28, 36)
    tables = [
        struct.pack("<iiiqqqq4x", first_at + 48 * k - shape_at, number, size, at, *rest)
        for k, (at, number, size, *rest) in enumerate(rows)
    ]
    items = offsets.ljust(shape_at, b"\0") + shape + b"".join(tables)
    return one_vector(b"FTAB", len(rows), items)


def _tree(sizes_px: Sizes) -> bytes:
    root = ElementTree.Element("dv", version="2.0")
    out = ElementTree.SubElement(root, "node", name="outInfo", path="/outInfo/")
    for k, (name, (width_px, height_px)) in enumerate(sizes_px.items()):
        path = f"/outInfo/{k}/"
        node = ElementTree.SubElement(out, "node", name=str(k), path=path)
        _attributes(
            node,
            compression="LZ4",
            originalModuleName="eventsweep",
            originalOutputName=name,
            typeDescription="Array of events (polarity ON/OFF).",
            typeIdentifier="EVTS",
        )
        info = ElementTree.SubElement(node, "node", name="info", path=f"{path}info/")
        _attributes(info, sizeX=width_px, sizeY=height_px, source="eventsweep")
    return ElementTree.tostring(root)


def _attributes(node: ElementTree.Element, **values: str | int) -> None:
    for key, value in values.items():
        kind = "int" if isinstance(value, int) else "string"
        ElementTree.SubElement(node, "attr", key=key, type=kind).text = str(value)


class FlatbufferTable:
    """The root table of a size-prefixed buffer."""

    def __init__(self, data: bytes | memoryview, kind: bytes, where: str) -> None:
        self._data, self._where = memoryview(data), where
        if len(data) < 12 or bytes(self._data[8:12]) != kind:
            raise InputError(f"{where}: no {kind.decode()} buffer; the file is damaged")
        size = self._unpack("<I", 0)
        if size + 4 > len(data):
            raise InputError(
                f"{where}: {size} bytes declared, {len(data) - 4} present; the file is damaged"
            )
        self._at = 4 + self._unpack("<I", 4)
        self._vtable = self._at - self._unpack("<i", self._at)
        self._fields = (self._unpack("<H", self._vtable) - 4) // 2

    def number(self, field: int, code: str, default: int) -> int:
        """A scalar field, by its `struct` code."""
        at = self._place(field)
        return default if at is None else self._unpack("<" + code, at)

    def vector(self, field: int, itemsize: int) -> memoryview:
        """The bytes of a vector (or text) field; empty where the field is not there."""
        at = self._place(field)
        if at is None:
            return self._data[:0]
        at += self._unpack("<I", at)
        count = self._unpack("<I", at)
        if at + 4 + count * itemsize > len(self._data):
            raise InputError(
                f"{self._where}: {count} items of {itemsize} bytes declared, "
                f"{len(self._data) - at - 4} bytes present; the file is damaged"
            )
        return self._data[at + 4 : at + 4 + count * itemsize]

    def _place(self, field: int) -> int | None:
        if field >= self._fields:
            return None
        offset = self._unpack("<H", self._vtable + 4 + 2 * field)
        return self._at + offset if offset else None

    def _unpack(self, code: str, at: int) -> int:
        if not 0 <= at <= len(self._data) - struct.calcsize(code):
            raise InputError(f"{self._where}: an offset points outside the buffer; damaged")
        return int(struct.unpack_from(code, self._data, at)[0])


def one_vector(kind: bytes, count: int, items: bytes) -> bytes:
    """A size-prefixed buffer whose root table holds one vector and nothing else."""
    root = struct.pack("<I4sHHHHiII", 16, kind, 0, 6, 8, 4, 6, 4, count)
    return struct.pack("<I", len(root) + len(items)) + root + items
