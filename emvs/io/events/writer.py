"""What every format's writer shares: packets of a bounded size, and an end that errors skip."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

from emvs.data.events import Events


class StreamWriter:
    """Appends packets of events, which `Checker` has already found to fit; use it as a context.

    Attributes:
        packet: how many events are written at once, at most.
    """

    packet = 1 << 16

    def append(self, stream: str, events: Events) -> None:
        """Writes a packet, in parts where it is large."""
        for start in range(0, len(events), self.packet):
            self._put(stream, events.slice(start, min(start + self.packet, len(events))))

    def _put(self, stream: str, events: Events) -> None:
        """Writes 1 to `packet` events."""
        raise NotImplementedError

    def _finish(self) -> None:
        """Writes what stands at the end of a whole file."""

    def _close(self) -> None:
        """Lets go of the file, whole or not."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if error is None:
                self._finish()
        finally:
            self._close()


class GatheringWriter(StreamWriter):
    """A writer to which large packets come much cheaper: small ones wait for each other."""

    packet = 1 << 20
    _LEAST = 1 << 18

    def __init__(self) -> None:
        self._waiting: dict[str, list[Events]] = {}
        self._counts: dict[str, int] = {}

    def append(self, stream: str, events: Events) -> None:
        """Writes a packet, or lets it wait."""
        self._waiting.setdefault(stream, []).append(events)
        self._counts[stream] = self._counts.get(stream, 0) + len(events)
        if self._counts[stream] >= self._LEAST:
            self._empty(stream)

    def _empty(self, stream: str) -> None:
        waiting = self._waiting.pop(stream)
        self._counts[stream] = 0
        super().append(stream, waiting[0] if len(waiting) == 1 else Events.concat(waiting))

    def _finish(self) -> None:
        for stream in list(self._waiting):
            self._empty(stream)


class FileWriter(StreamWriter):
    """A writer of bytes, one after another."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")

    def _close(self) -> None:
        self._file.close()
