"""Events in HDF5: in the layouts of DSEC, TUM-VIE, MVSEC, M3ED and others, or in any columns.

The first three are written, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import hdf5plugin
import numpy as np

from eventsweep.emvs.data.event_columns import BLOCK_ROWS, ColumnReader
from eventsweep.emvs.data.event_store import COLUMNS, EventStoreWriter, index_parts
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.hdf5 import COMPRESSION, Hdf5Writer, open_hdf5
from eventsweep.emvs.data.occupied import Span
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.base import GatheringWriter, StreamWriter
from eventsweep.emvs.formats.blocks import BlockReader, IndexedBlock
from eventsweep.emvs.formats.tables.columns import ColumnMap
from eventsweep.emvs.formats.tables.hdf5_layouts import MatrixReader, hdf5_layout

_CHUNK_ROWS = 1 << 16


class Hdf5Reader(BlockReader):
    """A file of events in any of the known layouts, or one whose columns are stated.

    Without an index by milliseconds, one pass over the times builds an index of blocks.
    """

    def __init__(self, path: Path, columns: ColumnMap | None = None) -> None:
        layout = hdf5_layout(Path(path), columns)
        super().__init__(Path(path), tuple(layout.streams))
        self.format = layout.format
        self.width_px, self.height_px = layout.size_px or (None, None)
        reader = MatrixReader if self.format == "mvsec" else ColumnReader
        self._readers = {name: reader(self.path, c, name) for name, c in layout.streams.items()}

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads the rows from front to back."""
        for place in self._places(stream):
            yield place, self.load(stream, place)

    def load(self, stream: str, place: Any) -> Events:
        """Reads a range of rows."""
        return self._readers[stream].rows(*place)

    def share_before(self, stream: str, place: Any) -> float:
        """Which share of the rows ends with a block."""
        return float(place[1] / max(1, self._readers[stream].count))

    def span_us(self, stream: str) -> tuple[int, int]:
        """Earliest and latest time stamp, µs."""
        self.check_stream(stream)
        return self._readers[stream].ends_us() or super().span_us(stream)

    def occupied_us(self, stream: str) -> list[Span]:
        """First and last event of stretches without a long silence, µs."""
        self.check_stream(stream)
        reader = self._readers[stream]
        return reader.occupied_us() if reader.is_indexed else super().occupied_us(stream)

    def between(self, stream: str, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`, in file order."""
        self.check_stream(stream)
        reader = self._readers[stream]
        if not reader.is_indexed:
            return super().between(stream, t0_us, t1_us)
        return reader.between(t0_us, t1_us)

    def _blocks(self, stream: str) -> Iterator[IndexedBlock]:
        """Reads the times alone."""
        for place in self._places(stream):
            with open_hdf5(self.path) as file:
                t_us = self._readers[stream].times_of(file, *place)
            yield IndexedBlock.of(place, t_us)

    def _places(self, stream: str) -> Iterator[tuple[int, int]]:
        count = self._readers[stream].count
        return ((k, min(k + BLOCK_ROWS, count)) for k in range(0, count, BLOCK_ROWS))


class DsecWriter(StreamWriter):
    """The layout of this project's own sequences, too."""

    packet = 1 << 20

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._writer = EventStoreWriter(path, width_px, height_px)

    def _put(self, _stream: str, events: Events) -> None:
        self._writer.append(events)

    def _close(self) -> None:
        self._writer.close()


class _Hdf5StreamWriter(GatheringWriter):
    """Extends data sets packet by packet."""

    def __init__(self, path: Path, kinds: dict[str, tuple[Any, tuple[int, ...]]]) -> None:
        super().__init__()
        self._hdf5 = Hdf5Writer(path)
        for name, (kind, shape) in kinds.items():
            kept = COMPRESSION.get(np.dtype(kind)) or hdf5plugin.Blosc(cname="lz4", clevel=5)
            self._hdf5.grow(name, kind, _CHUNK_ROWS, shape, **kept)

    def _close(self) -> None:
        self._hdf5.close()


class TumvieWriter(_Hdf5StreamWriter):
    """Columns with `ms_to_idx`, and no offset: times count from the recording's zero."""

    def __init__(self, path: Path) -> None:
        kinds = {f"events/{name}": (kind, ()) for name, kind in COLUMNS.items()}
        super().__init__(path, {**kinds, "ms_to_idx": (np.int64, ())})
        self._count = self._next_ms = 0

    def _put(self, _stream: str, events: Events) -> None:
        """Writes a packet and its part of the index."""
        for name, kind in COLUMNS.items():
            column = getattr(events, "t_us" if name == "t" else name)
            self._hdf5.extend(f"events/{name}", column.astype(kind, copy=False))
        for rows in index_parts(events.t_us, self._next_ms, self._count, 1 << 20):
            self._hdf5.extend("ms_to_idx", rows)
            self._next_ms += len(rows)
        self._count += len(events)


class MvsecWriter(_Hdf5StreamWriter):
    """`davis/left/events` and `davis/right/events`: rows of x, y, t in seconds, p as -1 or 1."""

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        sides = {name: name.rpartition("/")[2] for name in names}
        if set(sides.values()) - {"left", "right"}:
            sides = dict(zip(names, ("left", "right"), strict=False))
        if len(set(sides.values())) < len(names):
            raise InputError(f"{path}: streams {', '.join(names)}; needs a left and a right one")
        self._names = {name: f"davis/{side}/events" for name, side in sides.items()}
        super().__init__(path, dict.fromkeys(self._names.values(), (np.float64, (4,))))

    def _put(self, stream: str, events: Events) -> None:
        signs = np.where(events.p > 0, 1.0, -1.0)
        rows = np.column_stack([events.x, events.y, events.t_us / 1e6, signs])
        self._hdf5.extend(self._names[stream], rows)
