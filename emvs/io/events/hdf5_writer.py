"""Writes events as HDF5 in the layouts of DSEC, TUM-VIE and MVSEC."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import hdf5plugin
import numpy as np

from emvs.data.event_store import EventStoreWriter
from emvs.data.events import Events
from emvs.data.hdf5 import COMPRESSION, Hdf5Writer
from emvs.errors import InputError
from emvs.io.events.writer import GatheringWriter, StreamWriter

_ROWS = 1 << 16
_COLUMNS = {"x": np.uint16, "y": np.uint16, "t": np.int64, "p": np.uint8}


class DsecWriter(StreamWriter):
    """The layout of this project's own sequences, too."""

    packet = 1 << 20

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._writer = EventStoreWriter(path, width_px, height_px)

    def _put(self, stream: str, events: Events) -> None:
        del stream
        self._writer.append(events)

    def _close(self) -> None:
        self._writer.close()


class TumvieWriter(GatheringWriter):
    """Columns with `ms_to_idx`, and no offset: times count from the recording's zero."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._hdf5 = Hdf5Writer(path)
        self._count = self._next_ms = 0
        for name, kind in _COLUMNS.items():
            _create(self._hdf5, f"events/{name}", kind, (0,))
        _create(self._hdf5, "ms_to_idx", np.int64, (0,))

    def _put(self, stream: str, events: Events) -> None:
        """Writes a packet and its part of the index."""
        del stream
        for name, kind in _COLUMNS.items():
            column = getattr(events, "t_us" if name == "t" else name)
            _extend(self._hdf5, f"events/{name}", column.astype(kind, copy=False))
        after_ms = int(events.t_us[-1]) // 1000 + 1
        for first_ms in range(self._next_ms, after_ms, 1 << 20):
            stamps = np.arange(first_ms, min(first_ms + (1 << 20), after_ms)) * 1000
            rows = self._count + np.searchsorted(events.t_us, stamps, side="left")
            _extend(self._hdf5, "ms_to_idx", rows.astype(np.int64))
        self._next_ms = max(self._next_ms, after_ms)
        self._count += len(events)

    def _close(self) -> None:
        self._hdf5.close()


class MvsecWriter(GatheringWriter):
    """`davis/left/events` and `davis/right/events`: rows of x, y, t in seconds, p as -1 or 1."""

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        super().__init__()
        sides = {name: name.rpartition("/")[2] for name in names}
        if set(sides.values()) - {"left", "right"}:
            sides = dict(zip(names, ("left", "right"), strict=False))
        if len(set(sides.values())) < len(names):
            raise InputError(f"{path}: streams {', '.join(names)}; needs a left and a right one")
        self._names = {name: f"davis/{side}/events" for name, side in sides.items()}
        self._hdf5 = Hdf5Writer(path)
        for name in self._names.values():
            _create(self._hdf5, name, np.float64, (0, 4))

    def _put(self, stream: str, events: Events) -> None:
        rows = np.empty((len(events), 4), np.float64)
        rows[:, 0], rows[:, 1], rows[:, 2] = events.x, events.y, events.t_us / 1e6
        rows[:, 3] = np.where(events.p > 0, 1.0, -1.0)
        _extend(self._hdf5, self._names[stream], rows)

    def _close(self) -> None:
        self._hdf5.close()


def _create(hdf5: Hdf5Writer, name: str, kind: Any, shape: tuple[int, ...]) -> None:
    kept = COMPRESSION.get(np.dtype(kind)) or hdf5plugin.Blosc(cname="lz4", clevel=5)
    hdf5.file.create_dataset(
        name, shape, kind, maxshape=(None, *shape[1:]), chunks=(_ROWS, *shape[1:]), **kept
    )


def _extend(hdf5: Hdf5Writer, name: str, rows: Any) -> None:
    data = hdf5.file[name]
    count = data.shape[0]
    data.resize(count + len(rows), axis=0)
    data[count:] = rows
    hdf5.check()
