"""Writes Prophesee RAW files in EVT2 and EVT3."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from emvs.data.events import Events
from emvs.io.events.evt_encode import encode_evt2, encode_evt3, encoder_state
from emvs.io.events.evt_state import LOOPS

_CODINGS: dict[str, tuple[str, np.dtype[Any], Callable[..., int], int]] = {
    "evt2": ("2.0", np.dtype("<u4"), encode_evt2, 34),
    "evt3": ("3.0", np.dtype("<u2"), encode_evt3, 24),
}
_PACKET = 1 << 19


class RawWriter:
    """Appends sorted events to a RAW file; use it as a context."""

    def __init__(self, path: Path, kind: str, width_px: int, height_px: int) -> None:
        version, self._word, self._encode, self._loop_bits = _CODINGS[kind]
        self._state = encoder_state()
        self._file = path.open("wb")
        lines = [
            f"evt {version}",
            f"format {kind.upper()};height={height_px};width={width_px}",
            f"geometry {width_px}x{height_px}",
            "integrator_name eventsweep",
            "end",
        ]
        self._file.write("".join(f"% {line}\n" for line in lines).encode("ascii"))

    def append(self, stream: str, events: Events) -> None:
        """Writes a packet; `Checker` has already refused what does not fit."""
        del stream
        for start in range(0, len(events), _PACKET):
            part = events.slice(start, min(start + _PACKET, len(events)))
            loops = (int(part.t_us[-1]) >> self._loop_bits) - int(self._state[LOOPS])
            words = np.empty(8 * len(part) + 3 * loops + 8, self._word)
            count = self._encode(part.x, part.y, part.t_us, part.p, self._state, words)
            self._file.write(words[:count].data)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
