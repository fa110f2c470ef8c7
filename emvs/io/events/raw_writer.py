"""Writes Prophesee RAW files in EVT2 and EVT3."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from emvs.data.events import Events
from emvs.io.events.evt_encode import encode_evt2, encode_evt3, encoder_state
from emvs.io.events.evt_state import LOOPS
from emvs.io.events.writer import FileWriter

_CODINGS: dict[str, tuple[str, np.dtype[Any], Callable[..., int], int]] = {
    "evt2": ("2.0", np.dtype("<u4"), encode_evt2, 34),
    "evt3": ("3.0", np.dtype("<u2"), encode_evt3, 24),
}


class RawWriter(FileWriter):
    """Appends sorted events to a RAW file."""

    packet = 1 << 19

    def __init__(self, path: Path, kind: str, width_px: int, height_px: int) -> None:
        version, self._word, self._encode, self._loop_bits = _CODINGS[kind]
        self._state = encoder_state()
        super().__init__(path)
        lines = [
            f"evt {version}",
            f"format {kind.upper()};height={height_px};width={width_px}",
            f"geometry {width_px}x{height_px}",
            "integrator_name eventsweep",
            "end",
        ]
        self._file.write("".join(f"% {line}\n" for line in lines).encode("ascii"))

    def _put(self, stream: str, events: Events) -> None:
        del stream
        loops = (int(events.t_us[-1]) >> self._loop_bits) - int(self._state[LOOPS])
        words = np.empty(8 * len(events) + 3 * loops + 8, self._word)
        count = self._encode(events.x, events.y, events.t_us, events.p, self._state, words)
        self._file.write(words[:count].data)
