"""Writes events as text, with or without a size line, and as CSV with a header."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from emvs.data.events import Events
from emvs.io.events.text_kernels import format_rows
from emvs.io.events.writer import FileWriter


class TextWriter(FileWriter):
    """Appends lines."""

    def __init__(self, path: Path, kind: str, width_px: int, height_px: int) -> None:
        super().__init__(path)
        self._seconds = kind != "csv"
        self._gap = ord("," if kind == "csv" else " ")
        head = {"csv": "t_us,x,y,p\n", "esim-text": f"{width_px} {height_px}\n"}.get(kind, "")
        self._file.write(head.encode("ascii"))

    def _put(self, stream: str, events: Events) -> None:
        del stream
        text = np.empty(48 * len(events), np.uint8)
        columns = events.t_us, events.x, events.y, events.p
        size = format_rows(*columns, self._seconds, self._gap, text)
        self._file.write(text[:size].data)
