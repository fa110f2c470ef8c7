"""Writes events as text, with or without a size line, and as CSV with a header."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from emvs.data.events import Events
from emvs.io.events.text_kernels import format_rows

_PACKET = 1 << 16


class TextWriter:
    """Appends lines; use it as a context."""

    def __init__(self, path: Path, kind: str, width_px: int, height_px: int) -> None:
        self._seconds = kind != "csv"
        self._gap = ord("," if kind == "csv" else " ")
        self._file = path.open("wb")
        head = {"csv": "t_us,x,y,p\n", "esim-text": f"{width_px} {height_px}\n"}.get(kind, "")
        self._file.write(head.encode("ascii"))

    def append(self, stream: str, events: Events) -> None:
        """Writes a packet."""
        del stream
        for start in range(0, len(events), _PACKET):
            part = events.slice(start, min(start + _PACKET, len(events)))
            text = np.empty(48 * len(part), np.uint8)
            size = format_rows(part.t_us, part.x, part.y, part.p, self._seconds, self._gap, text)
            self._file.write(text[:size].data)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
