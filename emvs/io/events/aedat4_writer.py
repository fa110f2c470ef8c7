"""Writes AEDAT4 files, LZ4-compressed, with the table of packets at their end."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import lz4.frame
import numpy as np

from emvs.data.events import Events
from emvs.io.events.aedat4 import EVENT, MAGIC
from emvs.io.events.flatbuffer import one_vector
from emvs.io.events.writer import FileWriter

_LZ4 = 1


class Aedat4Writer(FileWriter):
    """Appends packets of up to 16384 events."""

    packet = 1 << 14

    def __init__(self, path: Path, width_px: int, height_px: int, names: Sequence[str]) -> None:
        self._numbers = {name: k for k, name in enumerate(names)}
        self._tree = _tree(width_px, height_px, names)
        self._table: list[tuple[int, int, int, int, int, int]] = []
        super().__init__(path)
        self._file.write(MAGIC + _header(self._tree, -1))

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
        self._file.write(_header(self._tree, place))


def _header(tree: bytes, table_place: int) -> bytes:
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


def _tree(width_px: int, height_px: int, names: Sequence[str]) -> bytes:
    root = ElementTree.Element("dv", version="2.0")
    out = ElementTree.SubElement(root, "node", name="outInfo", path="/outInfo/")
    for k, name in enumerate(names):
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
