"""Writes events as columns in an npz archive, uncompressed, so that slices are cheap to read."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from emvs.data.events import Events
from emvs.io.events.writer import StreamWriter

_COLUMNS: dict[str, type[np.generic]] = {
    "x": np.uint16,
    "y": np.uint16,
    "t_us": np.int64,
    "p": np.uint8,
}


class NpzWriter(StreamWriter):
    """Appends to one plain file per column; the archive is put together at the end."""

    packet = 1 << 20

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._path, self._size_px = path, {"width_px": width_px, "height_px": height_px}
        self._count = 0
        self._parts = {name: path.with_name(f"{path.name}.{name}") for name in _COLUMNS}
        self._files = {name: part.open("wb") for name, part in self._parts.items()}

    def _put(self, stream: str, events: Events) -> None:
        del stream
        self._count += len(events)
        for name, kind in _COLUMNS.items():
            self._files[name].write(np.ascontiguousarray(getattr(events, name), kind).data)

    def _finish(self) -> None:
        for file in self._files.values():
            file.flush()
        with zipfile.ZipFile(self._path, "w", zipfile.ZIP_STORED) as archive:
            for name, kind in _COLUMNS.items():
                member = zipfile.ZipInfo(f"{name}.npy")
                with (
                    archive.open(member, "w", force_zip64=True) as out,
                    self._parts[name].open("rb") as part,
                ):
                    _write_header(out, kind, (self._count,))
                    shutil.copyfileobj(part, out, 1 << 20)
            for name, value in self._size_px.items():
                with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as out:
                    _write_header(out, np.int64, ())
                    out.write(np.int64(value).tobytes())

    def _close(self) -> None:
        for file in self._files.values():
            file.close()
        for part in self._parts.values():
            part.unlink(missing_ok=True)


def _write_header(out: IO[bytes], kind: type[np.generic], shape: tuple[int, ...]) -> None:
    descr = np.lib.format.dtype_to_descr(np.dtype(kind))
    header = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(out, header)
